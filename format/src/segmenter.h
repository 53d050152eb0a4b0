// SPDX-License-Identifier: Apache-2.0
// Which segment of the timeline a primitive belongs to (spec 5.8).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "container.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// When a primitive can be seen within its part, ticks from the part's beginning; `never` where it
// cannot.
struct Lifetime {
  double begin = 0, end = 0;
  bool never = false;
};
// Of primitive i of a set, in a part of so many ticks. `widened`: so that rounding in a renderer
// cannot step out of it.
Lifetime lifetime_of(const Gaussians4D& set, std::size_t i, double length, bool widened = true);

inline constexpr double kMostSlots = 4294967295.0;  // of a level (spec 5.3)

struct Place {
  std::int16_t level = -1;
  std::uint32_t slot = 0;
  bool operator==(const Place&) const = default;
};
// Of a lifetime that lies in a part of so many ticks.
Place place_of(const Lifetime& lifetime, double chunk_ticks, double length);

// Primitives that share a place, ascending.
struct SegmentMembers {
  Place place;
  std::vector<std::uint32_t> members;
};
// A part's primitives: [first, last) of a set, drawn within an interval.
struct PartRange {
  std::uint32_t first = 0, last = 0;
  Interval interval;
  std::optional<TickRange> cut = {};  // see ScenePart
  double length() const { return interval.end - interval.begin; }
};
// Every primitive of the part exactly once, segments in file order (spec 5.6). Those that are never
// visible are persistent, or left out.
std::vector<SegmentMembers> segments_of(const Gaussians4D& set, const PartRange& part,
                                        double chunk_ticks, bool keep_never_visible);

// A chunk for these primitives, ticks: the best of the powers of two, weighing what a seek reads
// beyond what is alive against what each segment costs (spec 5.8). Looks at a sample of large sets.
double choose_chunk(const Gaussians4D& set, std::span<const PartRange> parts);

// Ticks that the parts last, together.
double ticks_of(std::span<const PartRange> parts);

}  // namespace stgs
