// SPDX-License-Identifier: Apache-2.0
// Whether decoded primitives are ones that can be drawn (spec 6.3).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "attributes.h"
#include "findings.h"

namespace stgs {

// Counts what `wrong(i)` answers and reports it once.
template <typename Wrong>
void check_each(std::size_t n, IssueNumber number, bool error, std::uint32_t segment,
                std::uint64_t offset, const char* what, Findings& findings, Wrong wrong) {
  std::size_t bad = 0, first = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (wrong(i) && bad++ == 0) first = i;
  }
  if (bad == 0) return;
  if (error) {
    findings.error(number, offset, "segment {}: {} primitives {}, the first is {}", segment, bad,
                   what, first);
  } else {
    findings.warning(number, offset, "segment {}: {} primitives {}, the first is {}", segment, bad,
                     what, first);
  }
}

// Finite, sigma > 0, radius >= 0, a quaternion that is not 0. `offset` is the segment's.
void check_primitives(const Gaussians4D& set, std::uint32_t segment, std::uint64_t offset,
                      Findings& findings);

// The payload of IMPO (spec 5.11): an importance for each of `primitives`. Empty where it holds
// something else. `offset` is the record's.
std::vector<float> parse_importance(std::span<const std::uint8_t> payload, std::uint64_t primitives,
                                    std::uint64_t offset, Findings& findings);

}  // namespace stgs
