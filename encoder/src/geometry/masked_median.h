// SPDX-License-Identifier: Apache-2.0
// The temporal median of bytes, with vectors over their positions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stgs::encoder::geometry {

inline constexpr std::size_t kMaxMedianSamples = 32;

// Computes the median over the samples that are not masked, for each of `count` positions: of n
// values the one of rank n / 2, counted from 0. Writes it to `medians` and n to `counts`; where n
// is 0, the median is 0. `samples`: at most kMaxMedianSamples arrays of `count` bytes; `masks`: one
// for each, 0 or 255 (masked), or null (nothing is masked). Thread-safe.
void masked_median(const std::vector<const std::uint8_t*>& samples,
                   const std::vector<const std::uint8_t*>& masks, std::size_t count,
                   std::uint8_t* medians, std::uint8_t* counts);

}  // namespace stgs::encoder::geometry
