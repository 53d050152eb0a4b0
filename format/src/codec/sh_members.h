// SPDX-License-Identifier: Apache-2.0
// The primitives that have values of the SH streams (spec 6.3).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "codec/stream.h"

namespace stgs {

// The primitives with an SH degree of at least 1, 2 and 3, ascending.
using ShMembers = std::array<std::vector<std::uint32_t>, kShBands>;

// The SH degrees of a record's primitives.
class ShDegrees {
 public:
  // `planes`: those of row sh_degree, of n symbols, which outlive this object.
  ShDegrees(const StreamRow& row, std::span<const Plane> planes, std::uint32_t n);

  std::uint32_t greatest() const { return greatest_; }
  // Returns the numbers of primitives of a degree of at least 1, 2 and 3.
  std::array<std::size_t, kShBands> counts() const;
  // Takes 4 bytes for each primitive that counts() counts.
  ShMembers members() const;

 private:
  std::vector<std::uint8_t> combined_;     // of several digits
  std::span<const std::uint8_t> degrees_;  // those above 255 as 255
  std::uint32_t greatest_ = 0;
};

}  // namespace stgs
