// SPDX-License-Identifier: Apache-2.0
// Mapping of planes to floats on the vector unit. All machines give the same floats (spec 7.5).
#pragma once

#include <cstddef>
#include <cstdint>

#include "codec/stream.h"

namespace stgs {

inline constexpr std::size_t kMaxComponents = 21;  // of an attribute

// Maps primitives [begin, end) of a stream; `begin` is a multiple of 64. `carry`: for predictions
// that depend on the previous value, the value of each component before `begin`; updated to that
// before `end`. Returns false if an integer is out of range.
bool map_task(const StreamTask& task, const SegmentContext& context, std::size_t begin,
              std::size_t end, std::uint64_t* carry, Gaussians4D& set);
// Adds the differences of primitives [begin, end), with kDelta or kMorton, to `sums` by component.
void sum_task(const StreamTask& task, std::size_t begin, std::size_t end, std::uint64_t* sums);
// Returns the bit of an attribute in a bit set.
constexpr std::uint32_t attribute_bit(Attribute attribute) {
  return 1u << static_cast<int>(attribute);
}
// Returns whether check_primitives() accepts primitives [begin, end). `floats`: the attributes
// stored as floats; only these can fail to be finite (spec 7.5).
bool all_renderable(const Gaussians4D& set, std::uint32_t floats, std::size_t begin,
                    std::size_t end);

}  // namespace stgs
