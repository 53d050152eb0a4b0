// SPDX-License-Identifier: Apache-2.0
// The frames of a window that have dynamic points.
#pragma once

#include <algorithm>
#include <vector>

namespace stgs::encoder::init {

// Returns every `interval`-th of [0, frames), so that each stands for itself and the frames around
// it. At least one; all for interval 1.
inline std::vector<int> point_frames(int frames, int interval) {
  const int step = std::clamp(interval, 1, std::max(frames, 1));
  std::vector<int> out;
  for (int frame = step / 2; frame < frames; frame += step) out.push_back(frame);
  return out;
}

}  // namespace stgs::encoder::init
