// SPDX-License-Identifier: Apache-2.0
// The content of lossless WebP images, which the browser decodes.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "interchange/webp_image.h"

namespace stgs::web {

struct WebpStream {
  ImageSize size;
  std::span<const std::uint8_t> bytes;  // at least 5, within those of the file
};

// Finds the lossless stream of an image, without decoding it. Rejects lossy and animated images.
// `label` is for messages.
Result<WebpStream> lossless_webp_stream(std::span<const std::uint8_t> bytes,
                                        const std::string& label);

}  // namespace stgs::web
