// SPDX-License-Identifier: Apache-2.0
// A training image as the frame store passes it to a backend.
#pragma once

#include <cstdint>
#include <memory>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// A use beyond the announced order.
inline constexpr std::uint64_t kNeverUsed = ~std::uint64_t{0};

// Shares ownership of its pixels, which may outlive the store that decoded them.
struct TrainingImage {
  std::shared_ptr<const Image8> pixels;
  std::uint64_t id = 0;  // identifies the image throughout a run
  // Indices of this use and of the next one, counting all images acquired. A cache evicts the image
  // with the latest next use.
  std::uint64_t use = 0, next_use = kNeverUsed;
};

// Wraps pixels without taking ownership; they must outlive the result.
inline TrainingImage borrowed_image(const Image8& image, std::uint64_t id) {
  return {std::shared_ptr<const Image8>(std::shared_ptr<void>(), &image), id};
}

}  // namespace stgs::encoder
