// SPDX-License-Identifier: Apache-2.0
// From integers to planes (spec 8.1 to 8.4): choice of prediction and digits, and the digits.
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
// is moved to the minimum of the integers: of each component, or of all three log scales. `coder`:
// kRans, used only if it should be smaller than the raw planes, or kBytes.
StreamPlan plan_stream(std::span<const Integers* const> records, Coder coder);

// Returns the row of a stream of a lossless scene, of kBytes.
StreamPlan plan_floats(Attribute attribute);

// Returns the row of positions in Morton order that Draco codes.
StreamPlan plan_draco(const Integers& positions);

// Returns the first key of a record's positions (spec 8.4). There is at least one position.
std::uint32_t first_key_of(const Integers& positions, const StreamPlan& plan);
// Appends the planes of a record's attribute, n symbols each.
void append_planes(const Integers& integers, const StreamPlan& plan,
                   std::vector<std::uint8_t>& planes);

}  // namespace stgs
