// SPDX-License-Identifier: Apache-2.0
#include "interchange/webp_image.h"

#include <webp/decode.h>

#include <algorithm>
#include <new>

namespace stgs {
namespace {

// Returns the memory that libwebp takes at most to decode an image of `bytes` bytes, besides its
// pixels (src/dec/vp8l_dec.c of versions 1.2 to 1.4):
// - a copy of the pixels, and of 17 rows
// - the images of two transforms and of the entropy codes, with a pixel for each 4 x 4
// - for each set of entropy codes a table of at most 5004 entries and its pointers. There are at
//   most 2^16 sets and one for each 4 x 4 pixels; a set takes at least 20 bits of the file.
std::uint64_t scratch_bytes(const ImageSize& size, std::uint64_t bytes) {
  constexpr std::uint64_t kSet = 5004 * 4 + 640, kFixed = 64 << 10;
  const auto width = static_cast<std::uint64_t>(size.width);
  const std::uint64_t tiles = (width + 3) / 4 * ((static_cast<std::uint64_t>(size.height) + 3) / 4);
  const std::uint64_t sets = std::min({std::uint64_t{1} << 16, tiles, bytes * 8 / 20 + 1});
  return 4 * (size.pixels() + 17 * width) + 3 * 4 * tiles + sets * kSet + kFixed;
}

}  // namespace

Result<ImageSize> lossless_webp_size(std::span<const std::uint8_t> bytes,
                                     const std::string& label) {
  WebPBitstreamFeatures features;
  const VP8StatusCode status = WebPGetFeatures(bytes.data(), bytes.size(), &features);
  if (status == VP8_STATUS_NOT_ENOUGH_DATA) {
    return invalid_file("{}: truncated within the header ({} bytes)", label, bytes.size());
  }
  if (status != VP8_STATUS_OK) return invalid_file("{}: not a WebP image", label);
  if (features.has_animation) return invalid_file("{}: animated WebP (expected one image)", label);
  if (features.format != 2) {
    return invalid_file("{}: lossy WebP (expected lossless, because pixels are data)", label);
  }
  return ImageSize{features.width, features.height};
}

Result<ImageRgba> decode_lossless_webp(std::span<const std::uint8_t> bytes,
                                       const std::string& label, ImportMemory& memory) {
  STGS_ASSIGN(const ImageSize size, lossless_webp_size(bytes, label));
  ImageRgba image;
  image.width = size.width;
  image.height = size.height;
  const std::string what = fmt::format("the {} x {} pixels of {}", size.width, size.height, label);
  STGS_ASSIGN(image.lease, memory.take(size.bytes(), what));
  STGS_ASSIGN(const Lease scratch, memory.take(scratch_bytes(size, bytes.size()), what));
  image.pixels.resize(static_cast<std::size_t>(size.bytes()));
  WebPDecoderConfig config;
  WebPInitDecoderConfig(&config);
  config.output.colorspace = MODE_RGBA;
  config.output.is_external_memory = 1;
  config.output.u.RGBA = {image.pixels.data(), 4 * image.width, image.pixels.size()};
  const VP8StatusCode status = WebPDecode(bytes.data(), bytes.size(), &config);
  if (status == VP8_STATUS_OUT_OF_MEMORY) throw std::bad_alloc();
  if (status != VP8_STATUS_OK) return invalid_file("{}: image is damaged or truncated", label);
  return image;
}

}  // namespace stgs
