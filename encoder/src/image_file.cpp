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

// The largest block that stb_image may allocate: it expands the data of a PNG image without limit.
thread_local std::size_t max_block = 0;
// Whether an allocation within max_block failed since it was set.
thread_local bool lacks_memory = false;

void set_max_block(std::size_t bytes) {
  max_block = bytes;
  lacks_memory = false;
}
void* noted(void* block) {
  lacks_memory = lacks_memory || block == nullptr;
  return block;
}
void* allocate(std::size_t bytes) {
  return bytes > max_block ? nullptr : noted(std::calloc(1, bytes));
}
void* reallocate(void* block, std::size_t bytes) {
  return bytes > max_block ? nullptr : noted(std::realloc(block, bytes));
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
#define STBI_MALLOC(size) allocate(size)
#define STBI_REALLOC(block, size) reallocate(block, size)
#define STBI_FREE(block) std::free(block)
#define memcpy copy_bytes
#include <stb_image.h>
#undef memcpy
#pragma GCC diagnostic pop

namespace stgs::encoder {

namespace {

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 30;  // fits the int that stb takes

constexpr std::uint8_t kMarker = 0xff, kStartOfImage = 0xd8, kEndOfImage = 0xd9, kHuffman = 0xc4,
                       kStartOfScan = 0xda;
// A scan of a few bytes takes a pass over the image. Encoders write about ten.
constexpr int kMaxScans = 200;

// The most pixels for each byte of a JPEG file: 8 times those of Huffman-coded blocks of one bit.
constexpr std::uint64_t kMaxJpegPixelsPerByte = 4096;

// Returns the pixels that a segment states which begins with its length; 0 for a frame header that
// decoders reject. The bytes of other codecs hardly ever look like one that they accept.
std::uint64_t pixels_of(std::span<const std::uint8_t> segment) {
  constexpr std::size_t kHeader = 8;
  if (segment.size() < kHeader) return 0;
  const std::size_t length = std::size_t{256} * segment[0] + segment[1], components = segment[7];
  if (components < 1 || components > 4 || length != kHeader + 3 * components) return 0;
  if (segment.size() < length || segment[2] < 1 || segment[2] > 16) return 0;  // bits
  for (std::size_t at = kHeader; at < length; at += 3) {
    const int sampling = segment[at + 1], table = segment[at + 2];
    if (sampling >> 4 == 0 || (sampling & 0xf) == 0 || table > 3) return 0;
  }
  const std::uint64_t height = 256u * segment[3] + segment[4];
  const std::uint64_t width = 256u * segment[5] + segment[6];
  return width * height;
}

// Returns the largest block that decoding an image needs: samples of 16 bits of 4 channels, or
// coefficients of JPEG in whole blocks, and twice the size where a buffer grows.
std::size_t largest_block(int width, int height) {
  constexpr std::size_t kPerPixel = 16, kMargin = 64, kLeast = std::size_t{1} << 20;
  return kLeast + kPerPixel * (static_cast<std::size_t>(width) + kMargin) *
                      (static_cast<std::size_t>(height) + kMargin);
}

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

Status no_memory(const std::string& path) {
  return {StatusCode::kNoMemory, path + ": not enough memory to decode the image"};
}

// Returns why stb_image failed. It quotes the type of an unknown chunk, which need not be text.
Status failure(const std::string& path) {
  if (lacks_memory) return no_memory(path);
  const std::string_view reason = stbi_failure_reason();
  const bool is_text = !reason.empty() && std::all_of(reason.begin(), reason.end(),
                                                      [](char c) { return c >= ' ' && c <= '~'; });
  return invalid_file("{}: cannot decode the image: {} (expected PNG or JPEG)", path,
                      is_text ? reason : "unknown PNG chunk");
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

bool is_jpeg_frame_header(std::uint8_t marker) {
  constexpr std::uint8_t kJpegLs = 0xf7, kExtension = 0xc8, kArithmetic = 0xcc;
  return marker == kJpegLs || (marker >= 0xc0 && marker <= 0xcf && marker != kHuffman &&
                               marker != kExtension && marker != kArithmetic);
}

bool is_truncated_jpeg(std::span<const std::uint8_t> bytes) {
  return is_jpeg(bytes) && !visit_segments(bytes, [](std::uint8_t, std::size_t) {});
}

Status check_jpeg(std::span<const std::uint8_t> bytes, const std::string& path) {
  if (!is_jpeg(bytes)) return {};
  bool has_valid_tables = true;
  int scans = 0, frames = 0;
  std::uint64_t pixels = 0;
  (void)visit_segments(bytes, [&](std::uint8_t code, std::size_t at) {
    if (code == kHuffman) has_valid_tables = has_valid_tables && tables_fit(bytes.subspan(at));
    if (code == kStartOfScan) ++scans;
    if (is_jpeg_frame_header(code)) ++frames, pixels += pixels_of(bytes.subspan(at));
  });
  if (!has_valid_tables) {
    return invalid_file("{}: cannot decode the image: a Huffman table has too many codes", path);
  }
  if (frames > 1) return invalid_file("{}: the JPEG file states its size {} times", path, frames);
  if (pixels / kMaxJpegPixelsPerByte > bytes.size()) {
    return invalid_file("{}: the JPEG file states {} pixels, more than its {} bytes can hold", path,
                        pixels, bytes.size());
  }
  if (scans <= kMaxScans) return {};
  return invalid_file("{}: the JPEG file has {} scans (expected at most {})", path, scans,
                      kMaxScans);
}

bool has_oversized_jpeg(std::span<const std::uint8_t> frame) {
  std::uint64_t pixels = 0;
  for (std::size_t at = 0; at + 2 < frame.size(); ++at) {
    const auto* const marker =
        static_cast<const std::uint8_t*>(std::memchr(&frame[at], kMarker, frame.size() - 2 - at));
    if (marker == nullptr) break;
    at = static_cast<std::size_t>(marker - frame.data());
    if (is_jpeg_frame_header(frame[at + 1])) pixels += pixels_of(frame.subspan(at + 2));
  }
  return pixels / kMaxJpegPixelsPerByte > frame.size();
}

Result<Image8> read_image8(const std::string& path, int channels, std::uint64_t max_memory) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  return read_image8(*source, channels, max_memory);
}

Result<Image8> read_image8(const ByteSource& file, int channels, std::uint64_t max_memory) {
  const std::string& path = file.name();
  if (file.size() > kMaxFileBytes) {
    return unsupported("{}: image file too large: {} bytes (limit {})", path, file.size(),
                       kMaxFileBytes);
  }
  try {
    std::vector<std::uint8_t> bytes(file.size());
    STGS_TRY(file.read(0, bytes));
    return decode_image8(bytes, channels, path, max_memory);
  } catch (const std::bad_alloc&) {
    return no_memory(path);
  }
}

Result<Image8> decode_image8(const std::vector<std::uint8_t>& bytes, int channels,
                             const std::string& path, std::uint64_t max_memory) {
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
  STGS_TRY(check_jpeg(bytes, path));
  const int size = static_cast<int>(bytes.size());
  Image8 image;
  set_max_block(largest_block(0, 0));
  if (stbi_info_from_memory(bytes.data(), size, &image.width, &image.height, &image.channels) ==
      0) {
    return failure(path);
  }
  STGS_TRY(check_image_size(image.width, image.height, path));
  // Of decoding: the inflated samples, the pixels, and their copy.
  const std::uint64_t need = bytes.size() + std::uint64_t{12} * static_cast<unsigned>(image.width) *
                                                static_cast<unsigned>(image.height);
  if (need > max_memory) {
    return unsupported(
        "{}: {}x{} pixels need {} bytes, more than the limit of {}; allow more memory", path,
        image.width, image.height, need, max_memory);
  }
  set_max_block(largest_block(image.width, image.height));
  const std::unique_ptr<stbi_uc, decltype(&stbi_image_free)> pixels(
      stbi_load_from_memory(bytes.data(), size, &image.width, &image.height, &image.channels,
                            channels),
      &stbi_image_free);
  if (!pixels) return failure(path);
  image.channels = channels;
  image.data.assign(pixels.get(),
                    pixels.get() + std::size_t{1} * image.width * image.height * channels);
  return image;
}

}  // namespace stgs::encoder
