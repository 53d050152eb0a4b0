// SPDX-License-Identifier: Apache-2.0
// Assignment of primitives to segments of the timeline (spec 5.8).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "container/container.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// When a primitive is visible within its part, ticks from the beginning of the part.
struct Lifetime {
  double begin = 0, end = 0;
  bool never = false;  // it is never visible
};
// Returns the lifetime of primitive i in a part of `length` ticks. `widened`: enlarged so that
// rounding in a renderer cannot exceed it.
// `origin`: the time from which those of the set count.
Lifetime lifetime_of(const Gaussians4D& set, std::size_t i, double length, bool widened = true,
                     double origin = 0);

inline constexpr double kMaxSlots = 4294967295.0;  // of a level (spec 5.3)

// The level and slot of a segment in its part.
struct SegmentKey {
  std::int16_t level = -1;
  std::uint32_t slot = 0;
  bool operator==(const SegmentKey&) const = default;
};
// Returns the shortest segment that contains a lifetime in a part of `length` ticks.
SegmentKey key_of(const Lifetime& lifetime, double chunk_ticks, double length);

// Primitives that share a key, ascending.
struct SegmentMembers {
  SegmentKey key;
  std::vector<std::uint32_t> members;
};
// The primitives of a part: [first, last) of a set, rendered within an interval.
struct PartRange {
  std::uint32_t first = 0, last = 0;
  TickRange interval;
  std::optional<TickRange> cut = {};  // see ScenePart
  double length() const { return interval.end - interval.begin; }
};
// Assigns every primitive of a part to one segment; segments are in file order (spec 5.6).
// Invisible primitives become persistent if `include_invisible`, else they are dropped.
std::vector<SegmentMembers> segments_of(const Gaussians4D& set, const PartRange& part,
                                        double chunk_ticks, bool include_invisible);

// Chooses the chunk for these primitives, ticks: the power of two with the best balance between
// inactive primitives read by a seek and the overhead of segments (spec 5.8). Samples large sets.
double choose_chunk(const Gaussians4D& set, std::span<const PartRange> parts);

// Returns the total duration of the parts, ticks.
double ticks_of(std::span<const PartRange> parts);

}  // namespace stgs
