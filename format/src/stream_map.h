// SPDX-License-Identifier: Apache-2.0
// From planes to floats on the machine's vector unit; the floats are the same on all (spec 7.5).
#pragma once

#include <cstddef>
#include <cstdint>

#include "stream.h"

namespace stgs {

inline constexpr std::size_t kMostComponents = 21;  // of an attribute

// Maps primitives [begin, end) of a stream. `carry`: where a value follows from the one before it,
// the value of each component before `begin`; set to that before `end`. `begin` is a multiple of
// 64. False: an integer is out of range.
bool map_task(const StreamTask& task, const SegmentContext& context, std::size_t begin,
              std::size_t end, std::uint64_t* carry, Gaussians4D& set);
// Adds to `sums` what those primitives' differences, of kDelta or kMorton, add to each component.
void sum_task(const StreamTask& task, std::size_t begin, std::size_t end, std::uint64_t* sums);
// The bit of an attribute in a set of them.
constexpr std::uint32_t attribute_bit(Attribute attribute) {
  return 1u << static_cast<int>(attribute);
}
// Whether primitives [begin, end) are ones that check_primitives finds no fault with. `floats`: the
// attributes stored as floats, which alone can fail to be finite (spec 7.5).
bool can_be_drawn(const Gaussians4D& set, std::uint32_t floats, std::size_t begin, std::size_t end);

}  // namespace stgs
