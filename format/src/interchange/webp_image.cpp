// SPDX-License-Identifier: Apache-2.0
#include "interchange/webp_image.h"

#include <webp/decode.h>

#include <new>

namespace stgs {

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
                                       const std::string& label, std::uint64_t max_bytes) {
  STGS_ASSIGN(const ImageSize size, lossless_webp_size(bytes, label));
  if (size.bytes() > max_bytes) {
    return unsupported("{}: {} x {} pixels need {} bytes, more than the memory limit of {} bytes",
                       label, size.width, size.height, size.bytes(), max_bytes);
  }
  ImageRgba image;
  image.width = size.width;
  image.height = size.height;
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
