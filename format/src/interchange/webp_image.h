// SPDX-License-Identifier: Apache-2.0
// Lossless WebP images used as arrays of numbers.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "interchange/import_memory.h"

namespace stgs {

struct ImageRgba {
  int width = 0, height = 0;         // pixels
  std::vector<std::uint8_t> pixels;  // row after row from the top, R G B A
  Lease lease = {};                  // of the pixels

  std::size_t size() const { return pixels.size() / 4; }
  const std::uint8_t* pixel(std::size_t i) const { return pixels.data() + 4 * i; }
};

struct ImageSize {
  int width = 0, height = 0;  // pixels, 1 to 16383

  std::uint64_t pixels() const {
    return static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  }
  std::uint64_t bytes() const { return 4 * pixels(); }  // of the decoded image
  bool operator==(const ImageSize&) const = default;
};

// Returns the size of an image without decoding it. Rejects lossy and animated images. `label` is
// for messages.
Result<ImageSize> lossless_webp_size(std::span<const std::uint8_t> bytes, const std::string& label);

// Decodes an image. `label` is for messages. Rejects lossy and animated images. Charges the pixels
// and, while they are decoded, the memory of libwebp.
Result<ImageRgba> decode_lossless_webp(std::span<const std::uint8_t> bytes,
                                       const std::string& label, ImportMemory& memory);

}  // namespace stgs
