// SPDX-License-Identifier: Apache-2.0
// The index of a file: a tree of nodes that list parts, segments and their records (spec 5).
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <tuple>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs {

// The content of a record. Together with a tier of the segment it forms a layer (spec 5.5).
enum class Content : std::uint8_t {
  kPrimitives = 0,  // all attributes; SH above degree 0 may be in a record of their own
  kSh = 1,          // the SH above degree 0
  kEnds = 3,        // ends of primitives of earlier records (container/ends.h)
};
inline constexpr int kMaxTierContent = 1;         // contents above it are further records
inline constexpr int kFirstPrivateContent = 192;  // spec 3.5
inline constexpr int kMaxTiers = 256;
constexpr std::uint16_t layer_of(Content content, int tier) {
  return static_cast<std::uint16_t>(static_cast<int>(content) << 8 | tier);
}
constexpr int tier_of(std::uint16_t layer) {
  return layer & 0xFF;
}
constexpr int content_of(std::uint16_t layer) {
  return layer >> 8;
}

// The bytes of a record, including its header.
struct RecordRange {
  std::uint64_t offset = 0, bytes = 0;
};

// One record that the index lists (spec 5.3).
struct IndexEntry : RecordRange {
  std::int16_t level = 0;
  std::uint16_t layer = 0;  // content and tier (spec 5.5)
  std::uint32_t slot = 0;
  std::uint32_t primitives = 0;
};

// Returns whether a further record contains ends (container/ends.h).
inline bool is_ends(const IndexEntry& entry) {
  return content_of(entry.layer) == static_cast<int>(Content::kEnds);
}

// A segment of one tier: its base record, and the SH record if SH are stored separately.
struct SegmentEntry {
  IndexEntry base;
  RecordRange sh;            // 0 bytes: no SH record
  std::uint32_t part = 0;    // index into the parts of the head
  std::uint32_t number = 0;  // of the segment, in the order of reading; equal in its tiers

  // Returns the entry of the SH record.
  IndexEntry sh_entry() const {
    return {sh, base.level, layer_of(Content::kSh, tier_of(base.layer)), base.slot,
            base.primitives};
  }
};

// A further record of a segment (spec 5.7).
struct FurtherEntry {
  IndexEntry entry;
  std::uint32_t part = 0;
  std::uint32_t number = 0;  // of the segment
};

// A part of the timeline (spec 5.3).
struct PartEntry {
  std::uint32_t number = 0;   // identifies it in the file
  double begin = 0, end = 0;  // ticks
  TickRange displayed;        // the times at which it is displayed
  double chunk_ticks = 0;
  bool operator<(const PartEntry& other) const {
    const auto key = [](const PartEntry& p) {
      return std::tie(p.number, p.begin, p.end, p.displayed.begin, p.displayed.end, p.chunk_ticks);
    };
    return key(*this) < key(other);
  }
};

// Bytes spent on an attribute.
struct AttributeBytes {
  std::uint16_t attribute = 0;
  std::uint64_t bytes = 0;
};

struct FileIndex {
  std::uint64_t primitives = 0;  // of the complete file, as stated
  std::uint32_t first = 0;       // number of the first of `segments`; 0 but for a ListedSegment
  std::vector<SegmentEntry> segments;
  std::vector<AttributeBytes> attributes;
  std::vector<FurtherEntry> further;
};

// A link to the node of another record (spec 5.2).
struct NodeLink {
  TickRange needed;  // closed: contains the times at which the segments below it are needed
  std::uint64_t offset = 0, copy = 0;  // of the record and of its copy; copy = 0: none
  std::uint64_t bytes = 0;             // of its payload
};

// Segments of one part whose records follow each other without gaps (spec 5.3).
struct IndexRun {
  PartEntry part;
  std::size_t segments = 0, further = 0;  // number of its entries in the lists of its node
  std::uint32_t count = 0;                // of segments, of all tiers together
};

struct IndexNode {
  std::vector<NodeLink> links;
  std::vector<IndexRun> runs;
  // The entries of the first run, then those of the next one; those of a run by ascending offset.
  // `part` is not set, and `number` counts from the beginning of the run.
  std::vector<SegmentEntry> segments;
  std::vector<FurtherEntry> further;

  // Calls visit(run, segments, further) for each run, with the spans of its entries.
  template <typename Visit>
  void for_each_run(const Visit& visit) const {
    std::span<const SegmentEntry> tiers = segments;
    std::span<const FurtherEntry> others = further;
    for (const IndexRun& run : runs) {
      visit(run, tiers.first(run.segments), others.first(run.further));
      tiers = tiers.subspan(run.segments);
      others = others.subspan(run.further);
    }
  }
};

// What searches backwards for FRAG records have found (spec 9.4, 9.5).
struct FragmentSearch {
  // A valid FRAG record; offset 0: there is none.
  struct Found {
    std::uint64_t offset = 0, end = 0;
    std::uint32_t frames = 0;
  };
  // By the offsets from which searches went backwards: the first valid record of each.
  std::map<std::uint64_t, Found> results;
  std::uint64_t in_vain = 0;  // bytes of payloads of records that are not valid (conformance 1.5)
  bool has_ended = false;     // because of the limit on `in_vain`
  bool has_last = false;      // last() has returned
  std::uint64_t damaged = 0;  // offset of a damaged record after the last valid one; 0: none
  // Offset of the first record that the last search found to extend past the end; 0: none.
  std::uint64_t cut_off = 0;
  std::uint64_t searched = 0;  // bytes, also of the searches before the file grew

  // Prepares for a source that had `before` bytes and has `now`. If many bytes have been searched
  // in vain, only those from the first record that was cut off are searched again.
  void resume(std::uint64_t before, std::uint64_t now);
};

// The state of following the links of an index.
struct IndexWalk {
  struct Link {
    NodeLink link;
    int depth = 1;  // number of links that lead to the node, counting this one
    std::optional<FurtherEntry> ends = {};  // it leads to this record of ends, not to a node
  };
  using Links = std::list<Link>;
  // What a node states, for the validator.
  struct Node {
    std::vector<NodeLink> links;
    TickRange needed;  // closed: times at which its own segments are needed; begin > end: never
  };
  struct Lost {
    std::uint64_t record = 0;  // offset of a record that a link leads to
    int issue = 0;             // why it cannot be used
  };
  Links pending;  // links that have not been followed, in their order; those of a node follow it
  std::set<std::uint64_t> followed;          // offsets of records, which may be damaged
  std::map<PartEntry, std::uint32_t> parts;  // their indices
  std::uint64_t entries = 0, bytes = 0;      // of the nodes read (conformance 1.5)
  std::uint64_t opening_bytes = 0;           // of the nodes read (container/opening.h)
  std::uint64_t pages = 0;                   // charged (container/opening.h)
  std::uint64_t complete_bytes = 0;          // of those that lie within the source
  std::uint64_t record_bytes = 0;            // of listed records that lie within it, payloads
  std::uint64_t records = 0;                 // listed
  std::uint32_t segments = 0;                // of the nodes read
  bool keeps_nodes = false;                  // in `nodes`
  std::map<std::uint64_t, Node> nodes;       // by the offset of their record; INDX: 0
  std::vector<NodeLink> earlier;             // links of fragments besides those of their nodes
  std::set<std::uint64_t> used_earlier;      // offsets of these fragments
  std::vector<Lost> lost;                    // in the order of following
  FragmentSearch search;
  std::uint64_t damaged = 0;  // FragmentSearch::damaged as it was last reported
};

// A chunk is a multiple of kChunkGrain and at most kMaxChunk, ticks, so that arithmetic on
// intervals is exact (spec 5.3).
inline constexpr double kChunkGrain = 0x1p-20, kMaxChunk = 0x1p32;
// Returns whether a chunk is valid.
bool is_chunk(double ticks);
// Returns the nearest valid chunk; 0 stays 0.
double to_chunk(double ticks);
// Returns whether a time is valid as an end of a part (spec 5.3).
bool is_valid_time(double ticks);
// Returns whether the times of a part are valid.
bool is_valid_part(const PartEntry& part);
// Returns the beginning of a segment, ticks from the beginning of its part (spec 5.4).
double begin_of(int level, std::uint32_t slot, double chunk_ticks);
// Returns the interval of a segment, from the beginning of its part, which lasts `length`.
TickRange interval_of(int level, std::uint32_t slot, double chunk_ticks, double length);
// Returns the times of the timeline at which a segment is needed; begin >= end: never.
TickRange needed_of(const IndexEntry& entry, const PartEntry& part);

// As above for an interval that counts from the beginning of a part with this range and cut.
TickRange needed_of(const TickRange& interval, const TickRange& part,
                    const std::optional<TickRange>& cut);
// Returns whether the end of `needed`, the result of needed_of() for a segment of `part`, is one of
// the times at which the segment is needed.
bool is_end_needed(const TickRange& needed, const PartEntry& part, double frames);
// Times of the timeline at which a segment is needed (spec 5.4).
struct NeededTimes {
  TickRange range;
  bool closed = false;  // range.end is one of them
};
// Returns those of a timeline of `frames` ticks, if there are any.
std::optional<NeededTimes> needed_times(const IndexEntry& entry, const PartEntry& part,
                                        double frames);
// Returns the least closed range of the times at which segments of a node are needed; begin > end:
// never.
TickRange needed_in(const IndexNode& node, double frames);
// Returns the closed range of the times at which segments below a node are needed; {0, 0}: never.
TickRange needed_of(const IndexNode& node);

// Returns the records that an index lists, by ascending offset.
std::vector<RecordRange*> records_of(FileIndex& index);
// Sorts the segments by part, and those of a part by offset. Parts are sorted by the offset of
// their first record.
void sort_index(std::vector<PartEntry>& parts, FileIndex& index);

}  // namespace stgs
