// SPDX-License-Identifier: Apache-2.0
// Checks of decoded values (spec 6.3).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "codec/attributes.h"
#include "container/findings.h"

namespace stgs {

// Primitives with a problem, counted a range at a time.
struct ProblemCount {
  std::size_t count = 0, first = 0;  // `first`: the number of the first one

  // Adds those primitives i < n for which `wrong(i)` is true. `begin`: the number of primitive 0.
  template <typename Wrong>
  void add(std::size_t n, std::size_t begin, Wrong wrong) {
    for (std::size_t i = 0; i < n; ++i) {
      if (wrong(i) && count++ == 0) first = begin + i;
    }
  }
  // Reports the problem in one finding, if there are such primitives among the n of the segment.
  void report(std::size_t n, IssueNumber number, bool error, std::uint32_t segment,
              std::uint64_t offset, std::string_view problem, Findings& findings) const;
};

// Checks that all values are finite, sigma > 0, radius >= 0 and quaternions are nonzero.
class PrimitiveChecks {
 public:
  // Adds n values of each of these attributes of `set`, which start with the value of number
  // `begin`: of SH that some primitives lack, of those that have it.
  void add(const Gaussians4D& set, AttributeBits attributes, std::size_t begin, std::size_t n);
  // Reports what was found, by attribute. `offset` is the segment's.
  void report(std::uint32_t segment, std::uint64_t offset, Findings& findings) const;

 private:
  static constexpr std::size_t kAttributes = static_cast<std::size_t>(Attribute::kSh3) + 1;
  std::array<std::size_t, kAttributes> values_{};  // by attribute, that were added
  std::array<ProblemCount, kAttributes> not_finite_;
  ProblemCount sigma_, radius_, rotation_;
};

// Parses the payload of IMPO (spec 11.9): an importance for each of `primitives`. Returns nothing
// and reports an error if it is invalid. `offset` is the record's.
std::vector<float> parse_importance(std::span<const std::uint8_t> payload, std::uint64_t primitives,
                                    std::uint64_t offset, Findings& findings);

}  // namespace stgs
