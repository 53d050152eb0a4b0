// SPDX-License-Identifier: Apache-2.0
// Ends: primitives of earlier records that stop being visible before their lifespan ends (spec
// 5.9).
#pragma once

#include <compare>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "container/findings.h"
#include "container/index.h"

namespace stgs {

// Identifies a record of content 0 in a file.
struct TierKey {
  std::uint32_t part = 0;   // its number
  std::uint64_t place = 0;  // 32 * slot + level + 1
  std::uint32_t tier = 0;
  auto operator<=>(const TierKey&) const = default;
};
// Returns the key of a record of content 0 in the part of this number.
TierKey tier_key(std::uint32_t part, const IndexEntry& base);

// Primitives of one record that end at the same time.
struct EndList {
  TierKey tier;
  std::uint32_t time = 0;                 // ticks from the beginning of the part of the ends
  std::vector<std::uint32_t> primitives;  // indices in the record, ascending
};
// The greatest number of ends in a record.
inline constexpr std::uint64_t kMaxEnds = 1 << 20;
// A record of ends that was read.
struct LoadedEnds {
  std::uint64_t offset = 0;    // of the record
  double begin = 0;            // of its part, ticks
  std::vector<EndList> lists;  // ascending by tier and time
};

// Returns the payload of a record of ends. The lists ascend strictly by tier and time.
std::vector<std::uint8_t> write_ends(const IndexEntry& entry, std::span<const EndList> lists);
// Parses the payload of a record of ends, which begins at `offset` of the file.
bool parse_ends(std::span<const std::uint8_t> payload, const IndexEntry& entry,
                std::uint64_t offset, std::vector<EndList>& lists, Findings& findings);

}  // namespace stgs
