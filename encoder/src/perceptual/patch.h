// SPDX-License-Identifier: Apache-2.0
// The part of a picture that the perceptual loss looks at in a step. As the network is the same
// everywhere, the mean over random patches is the whole picture's loss but for what the network
// sees beyond their border, where it takes zeros.
#pragma once

#include <algorithm>

#include "train/random.h"

namespace stgs::encoder {

struct Patch {
  int x = 0, y = 0, width = 0, height = 0;  // pixels
};

// The size of a patch of `size` x `size` pixels, cut to a picture of that many; 0: all of it.
inline Patch patch_size(int width, int height, int size) {
  if (size <= 0) return {0, 0, width, height};
  return {0, 0, std::min(width, size), std::min(height, size)};
}

// Such a patch at a random place: every place is as likely as any other.
inline Patch random_patch(int width, int height, int size, Random& random) {
  Patch patch = patch_size(width, height, size);
  patch.x = static_cast<int>(random.below(static_cast<std::uint64_t>(width - patch.width + 1)));
  patch.y = static_cast<int>(random.below(static_cast<std::uint64_t>(height - patch.height + 1)));
  return patch;
}

}  // namespace stgs::encoder
