// SPDX-License-Identifier: Apache-2.0
// The patch of an image that the perceptual loss evaluates in a step. The mean over
// random patches is close to the loss of the complete image; it differs at the borders of patches,
// beyond which the network sees zeros, and by the positions of its strides.
#pragma once

#include <algorithm>

#include "train/random.h"

namespace stgs::encoder {

struct Patch {
  int x = 0, y = 0, width = 0, height = 0;  // pixels
};

// Returns the size of a patch of `size` x `size` pixels, clipped to the image; `size` 0: the
// complete image. Its position is (0, 0).
inline Patch patch_size(int width, int height, int size) {
  if (size <= 0) return {0, 0, width, height};
  return {0, 0, std::min(width, size), std::min(height, size)};
}

// Returns a patch of that size at a uniformly random position.
inline Patch random_patch(int width, int height, int size, Random& random) {
  Patch patch = patch_size(width, height, size);
  patch.x = static_cast<int>(random.below(static_cast<std::uint64_t>(width - patch.width + 1)));
  patch.y = static_cast<int>(random.below(static_cast<std::uint64_t>(height - patch.height + 1)));
  return patch;
}

}  // namespace stgs::encoder
