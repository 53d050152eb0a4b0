// SPDX-License-Identifier: Apache-2.0
// Which points belong to the visual hull of a frame, for the CPU and CUDA. A point does if it is
// inside the mask
//   - in at least three of the views that see it (two if there are only two views), and
//   - in nearly all of them (about one miss in eight is allowed).
#pragma once

#include <algorithm>
#include <cmath>

#include "stgs/format/math/lang.h"

namespace stgs::encoder::geometry {

// Returns how many of the views that see a point may see it outside of the mask.
STGS_FN int misses_allowed(int views) {
  return views / 8 + (views >= 5 ? 1 : 0);
}

// Returns whether a point is in the hull. `inside`, `outside`: the numbers of views that see it
// inside and outside of their masks; `views`: of all views.
STGS_FN bool is_in_hull(int inside, int outside, int views) {
  const int needed = views < 3 ? 2 : 3;
  return inside >= needed && outside <= misses_allowed(inside + outside);
}

inline constexpr int kMaxHullPlanes = 64;  // of a sweep

// The search for the depths of a part of the hull.
inline constexpr int kHullDepths = 160;  // sampled depths of a ray, even in inverse depth

// Returns the distance between the sampled pixels of a mask with so many, for about 256 samples; at
// most 4, so that thin content is found.
inline int hull_stride(int masked) {
  return std::clamp(static_cast<int>(std::sqrt(masked / 256.0)), 1, 4);
}

}  // namespace stgs::encoder::geometry
