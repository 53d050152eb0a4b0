// SPDX-License-Identifier: Apache-2.0
// Checks of decoded values (spec 6.3).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "codec/attributes.h"
#include "container/findings.h"

namespace stgs {

// Reports the primitives for which `wrong(i)` is true in one finding, if there are any.
template <typename Wrong>
void check_each(std::size_t n, IssueNumber number, bool error, std::uint32_t segment,
                std::uint64_t offset, const char* problem, Findings& findings, Wrong wrong) {
  std::size_t bad = 0, first = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (wrong(i) && bad++ == 0) first = i;
  }
  if (bad == 0) return;
  if (error) {
    findings.error(number, offset, "segment {}: {} in {} of {} primitives (first: {})", segment,
                   problem, bad, n, first);
  } else {
    findings.warning(number, offset, "segment {}: {} in {} of {} primitives (first: {})", segment,
                     problem, bad, n, first);
  }
}

// Checks that all values are finite, sigma > 0, radius >= 0 and quaternions are nonzero. `offset`
// is the segment's.
void check_primitives(const Gaussians4D& set, std::uint32_t segment, std::uint64_t offset,
                      Findings& findings);

// Parses the payload of IMPO (spec 11.9): an importance for each of `primitives`. Returns nothing
// and reports an error if it is invalid. `offset` is the record's.
std::vector<float> parse_importance(std::span<const std::uint8_t> payload, std::uint64_t primitives,
                                    std::uint64_t offset, Findings& findings);

}  // namespace stgs
