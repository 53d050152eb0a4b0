// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/image_file.h"

#include <cstdlib>
#include <memory>

#include "stgs/format/camera.h"

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
#include <stb_image.h>
#pragma GCC diagnostic pop

namespace stgs::encoder {

namespace {

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 30;  // fits the int that stb takes

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
  constexpr std::uint8_t kMarker = 0xff, kStartOfImage = 0xd8, kEndOfImage = 0xd9;
  if (bytes.size() < 2 || bytes[0] != kMarker || bytes[1] != kStartOfImage) return false;
  std::size_t at = 2;
  while (at + 1 < bytes.size()) {
    // Entropy-coded data lies between segments. There, 0 or a restart code may follow 0xff.
    const std::uint8_t code = bytes[at + 1];
    const bool segment = code >= 0xc0 && (code < 0xd0 || code > kStartOfImage) && code != kMarker;
    if (bytes[at] != kMarker || !segment) {
      ++at;
      continue;
    }
    if (code == kEndOfImage) return false;
    at += 2;
    // Skip the segment: an embedded thumbnail has markers of its own.
    if (at + 1 < bytes.size()) at += std::size_t{256} * bytes[at] + bytes[at + 1];
  }
  return true;
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
  const int size = static_cast<int>(bytes.size());
  Image8 image;
  if (stbi_info_from_memory(bytes.data(), size, &image.width, &image.height, &image.channels) ==
      0) {
    return invalid_file("{}: cannot decode the image: {} (expected PNG or JPEG)", path,
                        stbi_failure_reason());
  }
  STGS_TRY(check_image_size(image.width, image.height, path));
  const std::unique_ptr<stbi_uc, decltype(&stbi_image_free)> pixels(
      stbi_load_from_memory(bytes.data(), size, &image.width, &image.height, &image.channels,
                            channels),
      &stbi_image_free);
  if (!pixels) {
    return invalid_file("{}: cannot decode the image: {} (expected PNG or JPEG)", path,
                        stbi_failure_reason());
  }
  image.channels = channels;
  image.data.assign(pixels.get(),
                    pixels.get() + std::size_t{1} * image.width * image.height * channels);
  return image;
}

}  // namespace stgs::encoder
