// SPDX-License-Identifier: Apache-2.0
// Images of the importers (format/src/interchange/webp_image.h), decoded by the browser.
#include <fmt/format.h>

#include "host_decoding.h"
#include "webp_stream.h"

namespace stgs {

using View = std::span<const std::uint8_t>;

Result<ImageSize> lossless_webp_size(View bytes, const std::string& label) {
  STGS_ASSIGN(const web::WebpStream stream, web::lossless_webp_stream(bytes, label));
  return stream.size;
}

Result<ImageRgba> decode_lossless_webp(View bytes, const std::string& label, ImportMemory& memory) {
  STGS_ASSIGN(const ImageSize size, lossless_webp_size(bytes, label));
  const View pixels = web::host_decoding().content(web::Coding::kWebp, label);
  if (pixels.size() != size.bytes()) {
    return runtime_error("{}: the pixels were not requested from the browser", label);
  }
  ImageRgba image;
  image.width = size.width;
  image.height = size.height;
  STGS_ASSIGN(image.lease, memory.take(size.bytes(), fmt::format("the {} x {} pixels of {}",
                                                                 size.width, size.height, label)));
  image.pixels.assign(pixels.begin(), pixels.end());
  return image;
}

}  // namespace stgs
