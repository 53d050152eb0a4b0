// SPDX-License-Identifier: Apache-2.0
// The segments that a recorder has written, so that their primitives can end.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "container/ends.h"
#include "scene/body_write.h"
#include "stgs/format/scene_recorder.h"

namespace stgs {

// A record of ends and the part that contains it alone. The offset and the part's number are not
// set.
struct EndRecord {
  PartEntry part;
  FurtherEntry entry;
  std::vector<std::uint8_t> bytes;
};

// Appends the records of a part to `bytes`, which follow `begin` bytes of the file, and sets their
// offsets.
void append_records(Body& body, std::uint64_t begin, std::vector<std::uint8_t>& bytes);

// Sets the locations of the primitives of a part, by their index in the scene.
void locate(const Body& body, std::vector<StoredPrimitive>& locations);

// The records of content 0 of a recording, by offset.
class RecordedSegments {
 public:
  // Adds a record of the part of this number.
  void add(std::uint32_t part, const IndexEntry& base);
  // Moves all records of `other` here. Does not throw.
  void merge(RecordedSegments other) noexcept { segments_.merge(other.segments_); }

  // Checks ends of a fragment up to `end_frame` of the file of this name. kUsage
  Status check(const std::string& name, std::span<const PrimitiveEnd> ends,
               std::uint32_t end_frame) const;
  // Returns a record of checked ends, at least one. Its part begins with the first of them and does
  // not end before the scene.
  EndRecord record_of(std::span<const PrimitiveEnd> ends, double chunk_ticks) const;

 private:
  struct Segment {
    TierKey tier;
    std::uint32_t primitives = 0;
  };
  std::map<std::uint64_t, Segment> segments_;
};

}  // namespace stgs
