// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/image_file.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string_view>

#include "stgs/format/camera.h"

namespace {

// stb_image copies 0 bytes to a null pointer, which memcpy() does not allow.
void* copy_bytes(void* to, const void* from, std::size_t count) {
  return count == 0 ? to : std::memcpy(to, from, count);
}

}  // namespace

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#define STBI_NO_STDIO
// Zeroed, because a JPEG image may use tables that it does not define, and not all versions of
// stb_image clear them.
#define STBI_MALLOC(size) std::calloc(1, size)
#define STBI_REALLOC(block, size) std::realloc(block, size)
#define STBI_FREE(block) std::free(block)
#define memcpy copy_bytes
#include <stb_image.h>
#undef memcpy
#pragma GCC diagnostic pop

namespace stgs::encoder {

namespace {

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 30;  // fits the int that stb takes

constexpr std::uint8_t kMarker = 0xff, kStartOfImage = 0xd8, kEndOfImage = 0xd9, kHuffman = 0xc4;

bool is_jpeg(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= 2 && bytes[0] == kMarker && bytes[1] == kStartOfImage;
}

// Calls visit(code, offset of the length) for each segment of a JPEG file. Returns whether the file
// has an end-of-image marker.
template <typename Visit>
bool visit_segments(std::span<const std::uint8_t> bytes, Visit visit) {
  std::size_t at = 2;
  while (at + 1 < bytes.size()) {
    // Entropy-coded data lies between segments. There, 0 or a restart code may follow 0xff.
    const std::uint8_t code = bytes[at + 1];
    const bool segment = code >= 0xc0 && (code < 0xd0 || code > kStartOfImage) && code != kMarker;
    if (bytes[at] != kMarker || !segment) {
      ++at;
      continue;
    }
    if (code == kEndOfImage) return true;
    at += 2;
    visit(code, at);
    // Skip the segment: an embedded thumbnail has markers of its own.
    if (at + 1 < bytes.size()) at += std::size_t{256} * bytes[at] + bytes[at + 1];
  }
  return false;
}

// Returns whether the Huffman tables of a segment have at most 256 codes each. stb_image 2.27
// writes past the end of larger ones. `bytes` begins with the length of the segment, but stb_image
// reads the last table beyond it.
bool tables_fit(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kLengths = 16, kMaxCodes = 256;
  if (bytes.size() < 2) return true;
  const std::size_t end = std::size_t{256} * bytes[0] + bytes[1];
  for (std::size_t at = 2; at < end && at < bytes.size();) {
    std::size_t codes = 0;
    for (std::size_t i = at + 1; i <= at + kLengths && i < bytes.size(); ++i) codes += bytes[i];
    if (codes > kMaxCodes) return false;
    at += 1 + kLengths + codes;
  }
  return true;
}

// Returns whether all Huffman tables of a JPEG file are valid. True for other files.
bool has_valid_tables(std::span<const std::uint8_t> bytes) {
  bool valid = true;
  const auto check = [&](std::uint8_t code, std::size_t at) {
    if (code == kHuffman) valid = valid && tables_fit(bytes.subspan(at));
  };
  if (is_jpeg(bytes)) (void)visit_segments(bytes, check);
  return valid;
}

// Returns why stb_image failed. It quotes the type of an unknown chunk, which need not be text.
std::string_view failure() {
  const std::string_view reason = stbi_failure_reason();
  const bool is_text = !reason.empty() && std::all_of(reason.begin(), reason.end(),
                                                      [](char c) { return c >= ' ' && c <= '~'; });
  return is_text ? reason : "unknown PNG chunk";
}

}  // namespace

Status check_image_size(std::int64_t width, std::int64_t height, const std::string& path) {
  if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide) {
    return invalid_file("{}: invalid image size {}x{} (expected 1 to {} pixels per side)", path,
                        width, height, kMaxImageSide);
  }
  if (width * height > kMaxImagePixels) {
    return unsupported("{}: image too large: {}x{} (limit {} pixels)", path, width, height,
                       kMaxImagePixels);
  }
  return {};
}

bool is_truncated_jpeg(std::span<const std::uint8_t> bytes) {
  return is_jpeg(bytes) && !visit_segments(bytes, [](std::uint8_t, std::size_t) {});
}

Result<Image8> read_image8(const std::string& path, int channels) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  return read_image8(*source, channels);
}

Result<Image8> read_image8(const ByteSource& file, int channels) {
  const std::string& path = file.name();
  if (file.size() > kMaxFileBytes) {
    return unsupported("{}: image file too large: {} bytes (limit {})", path, file.size(),
                       kMaxFileBytes);
  }
  try {
    std::vector<std::uint8_t> bytes(file.size());
    STGS_TRY(file.read(0, bytes));
    return decode_image8(bytes, channels, path);
  } catch (const std::bad_alloc&) {
    return runtime_error("{}: not enough memory to decode the image", path);
  }
}

Result<Image8> decode_image8(const std::vector<std::uint8_t>& bytes, int channels,
                             const std::string& path) {
  if (bytes.size() > kMaxFileBytes) {
    return unsupported("{}: image file too large: {} bytes (limit {})", path, bytes.size(),
                       kMaxFileBytes);
  }
  if (is_truncated_jpeg(bytes)) {
    return invalid_file(
        "{}: truncated JPEG (no end-of-image marker in {} bytes); copy the file again, or "
        "re-encode "
        "it if its writer omits the marker",
        path, bytes.size());
  }
  if (!has_valid_tables(bytes)) {
    return invalid_file("{}: cannot decode the image: a Huffman table has too many codes", path);
  }
  const int size = static_cast<int>(bytes.size());
  Image8 image;
  if (stbi_info_from_memory(bytes.data(), size, &image.width, &image.height, &image.channels) ==
      0) {
    return invalid_file("{}: cannot decode the image: {} (expected PNG or JPEG)", path, failure());
  }
  STGS_TRY(check_image_size(image.width, image.height, path));
  const std::unique_ptr<stbi_uc, decltype(&stbi_image_free)> pixels(
      stbi_load_from_memory(bytes.data(), size, &image.width, &image.height, &image.channels,
                            channels),
      &stbi_image_free);
  if (!pixels) {
    return invalid_file("{}: cannot decode the image: {} (expected PNG or JPEG)", path, failure());
  }
  image.channels = channels;
  image.data.assign(pixels.get(),
                    pixels.get() + std::size_t{1} * image.width * image.height * channels);
  return image;
}

}  // namespace stgs::encoder
