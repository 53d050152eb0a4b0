// SPDX-License-Identifier: Apache-2.0
// From integers to planes (spec 7.3, 7.4): choice of prediction and digits, and the digits.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "codec/stream.h"

namespace stgs {

// The layout row of an attribute in records that share a layout.
struct StreamPlan {
  StreamRow row;                       // without tables
  std::vector<std::uint32_t> minimum;  // of each component; values are coded relative to it
};

// Chooses the cheapest row for one attribute of several records. If the mapping has an origin, it
// is moved to the minimum of the integers. `coder`: kRans, used only if it should be smaller than
// the raw planes, or kBytes.
StreamPlan plan_stream(std::span<const Integers* const> records, Coder coder);

// Returns the row of an attribute stored as floats.
StreamPlan plan_floats(Attribute attribute);

// Returns the row of positions, given as Morton keys, that Draco codes.
StreamPlan plan_draco(const Integers& positions);

// Appends the planes of a record's attribute, n symbols each.
void append_planes(const Integers& integers, const StreamPlan& plan,
                   std::vector<std::uint8_t>& planes);

// Encodes the planes of a stream, `n` symbols each, as kBytes (spec 7.2).
std::vector<std::uint8_t> compress_planes(std::span<const std::uint8_t> planes, std::size_t n,
                                          int zstd_level);

}  // namespace stgs
