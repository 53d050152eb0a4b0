// SPDX-License-Identifier: Apache-2.0
// The primitives that have values of the SH streams (spec 6.3).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "codec/stream.h"

namespace stgs {

// The primitives with an SH degree of at least 1, 2 and 3, ascending.
using ShMembers = std::array<std::vector<std::uint32_t>, kShBands>;

// Finds the members among n primitives from the planes of row sh_degree. `counts`: the expected
// number of each, for allocation only. If a degree is greater than `max_degree`, which is at most
// kShBands, the function stops and returns it.
std::optional<std::uint32_t> find_members(const StreamRow& row, std::span<const Plane> planes,
                                          std::uint32_t n, std::uint32_t max_degree,
                                          std::span<const std::uint32_t, kShBands> counts,
                                          ShMembers& members);

}  // namespace stgs
