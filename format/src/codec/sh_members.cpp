// SPDX-License-Identifier: Apache-2.0
#include "codec/sh_members.h"

namespace stgs {

std::optional<std::uint32_t> find_members(const StreamRow& row, std::span<const Plane> planes,
                                          std::uint32_t n, std::uint32_t max_degree,
                                          std::span<const std::uint32_t, kShBands> counts,
                                          ShMembers& members) {
  for (std::size_t k = 0; k < kShBands; ++k) members[k].reserve(counts[k]);
  for (std::uint32_t i = 0; i < n; ++i) {
    std::uint32_t degree = 0;
    int shift = 0;
    for (std::size_t d = 0; d < planes.size(); shift += row.digit_bits[d++])
      degree |= std::uint32_t{planes[d].symbols ? planes[d].symbols[i] : planes[d].only} << shift;
    if (degree > max_degree) return degree;
    for (std::uint32_t k = 0; k < degree; ++k) members[k].push_back(i);
  }
  return std::nullopt;
}

}  // namespace stgs
