// SPDX-License-Identifier: Apache-2.0
#include "interchange/webp_image.h"

#include <webp/decode.h>

namespace stgs {

Result<ImageRgba> decode_lossless_webp(std::span<const std::uint8_t> bytes,
                                       const std::string& label, std::uint64_t max_bytes) {
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
  ImageRgba image;
  image.width = features.width;
  image.height = features.height;
  const std::uint64_t size = std::uint64_t{4} * static_cast<std::uint64_t>(image.width) *
                             static_cast<std::uint64_t>(image.height);
  if (size > max_bytes) {
    return unsupported("{}: {} x {} pixels need {} bytes, more than the memory limit of {} bytes",
                       label, image.width, image.height, size, max_bytes);
  }
  image.pixels.resize(static_cast<std::size_t>(size));
  if (WebPDecodeRGBAInto(bytes.data(), bytes.size(), image.pixels.data(), image.pixels.size(),
                         4 * image.width) == nullptr) {
    return invalid_file("{}: image is damaged or truncated", label);
  }
  return image;
}

}  // namespace stgs
