// SPDX-License-Identifier: Apache-2.0
#include "held_segment.h"

#include <cmath>
#include <limits>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs::player {

// Widens by what float arithmetic can lose, so that the slice, not the timeline, decides on the
// last bit. Empty supports become begin > end.
HeldSegment::HeldSegment(Gaussians4D decoded) : set(std::move(decoded)) {
  begin.resize(set.size());
  end.resize(set.size());
  for (std::size_t i = 0; i < set.size(); ++i) {
    const float opacity = math::opacity_of(set.opacity_logit[i]);
    const float slack = 1e-5f * math::kAlphaThreshold;
    const float half = math::support_half_width(opacity + slack, set.sigma[i], set.radius[i],
                                                math::kAlphaThreshold);
    const float margin = 1e-5f * (std::abs(set.time[i]) + std::abs(half)) + 1e-5f;
    begin[i] = half < 0 ? std::numeric_limits<float>::max() : set.time[i] - half - margin;
    end[i] = half < 0 ? std::numeric_limits<float>::lowest() : set.time[i] + half + margin;
  }
}

void HeldSegment::find_candidates(float ticks, std::vector<std::uint32_t>& candidates) const {
  candidates.resize(begin.size());
  std::size_t n = 0;
  for (std::size_t i = 0; i < begin.size(); ++i) {
    candidates[n] = static_cast<std::uint32_t>(i);
    n += static_cast<std::size_t>((begin[i] <= ticks) & (ticks <= end[i]));
  }
  candidates.resize(n);
}

std::uint64_t held_bytes(std::uint64_t n, int sh_degree) {
  const auto coefficients = static_cast<std::uint64_t>((sh_degree + 1) * (sh_degree + 1));
  const std::uint64_t floats = 3 + 3 + 4 + 1 + 3 * coefficients + 1 + 3 + 1 + 1;
  return n * (floats * sizeof(float) + 2 * sizeof(float) + sizeof(std::uint32_t));
}

}  // namespace stgs::player
