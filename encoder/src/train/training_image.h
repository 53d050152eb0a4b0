// SPDX-License-Identifier: Apache-2.0
// A training picture as it is handed from the frames to a backend.
#pragma once

#include <cstdint>
#include <memory>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Moments of use that are further ahead than anyone knows.
inline constexpr std::uint64_t kNeverUsed = ~std::uint64_t{0};

// Whoever holds it keeps the pixels alive, whatever becomes of the store that they came from.
struct TrainingImage {
  std::shared_ptr<const Image8> pixels;
  std::uint64_t id = 0;  // one id is one picture through a run
  // When it is used, counted in pictures handed out, and when the next time; so that a cache can
  // give up what is needed last.
  std::uint64_t use = 0, next_use = kNeverUsed;
};

// Pixels that the caller keeps alive.
inline TrainingImage borrowed_image(const Image8& image, std::uint64_t id) {
  return {std::shared_ptr<const Image8>(std::shared_ptr<void>(), &image), id};
}

}  // namespace stgs::encoder
