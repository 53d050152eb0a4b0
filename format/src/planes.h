// SPDX-License-Identifier: Apache-2.0
// From integers to planes (spec 7.3, 7.4): which prediction and which digits a stream gets, and the
// digits themselves.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "stream.h"

namespace stgs {

// A stream of records that share a layout, and the least integer of each component, from which the
// row's origin makes the others count.
struct StreamPlan {
  StreamRow row;  // without tables
  std::vector<std::uint32_t> least;
};

// The row of least cost for one attribute of several records; its origin is the integers', moved to
// their least where the mapping has one. `coder`: kRans where that is expected to save anything
// against the planes as they are, or kBytes.
StreamPlan plan_stream(std::span<const Integers* const> records, Coder coder);

// The row of an attribute that is stored as floats.
StreamPlan plan_floats(Attribute attribute);

// The row of positions, keys all of them, that Draco codes.
StreamPlan plan_draco(const Integers& positions);

// Appends the planes of a record's attribute, n symbols each.
void append_planes(const Integers& integers, const StreamPlan& plan,
                   std::vector<std::uint8_t>& planes);

// A stream's planes as kBytes stores them (spec 7.2), `n` symbols each.
std::vector<std::uint8_t> compress_planes(std::span<const std::uint8_t> planes, std::size_t n,
                                          int zstd_level);

}  // namespace stgs
