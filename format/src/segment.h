// SPDX-License-Identifier: Apache-2.0
// The payload of a SEGM record: who it is, which layout it has, the bytes of its streams (spec 6).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "container.h"
#include "layout.h"

namespace stgs {

// The planes of a record's primitives in the order of its layout's streams, n symbols each.
struct RecordPlanes {
  std::size_t n = 0;
  std::uint64_t first_key = 0;
  std::vector<std::uint8_t> symbols;
};

// How a record of this layout is written. The layout is one of `set`, which holds its tables too.
struct RecordCoding {
  const LayoutSet* set = nullptr;
  std::uint16_t layout = 0;
  bool own = false;  // `set` is written into the record: it has this layout alone
  int zstd_level = 9;
};
struct SegmentPayload {
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint64_t> stored;  // bytes of each stream, 0 where it is coded with rANS
};
SegmentPayload write_segment(const IndexEntry& entry, const RecordPlanes& planes,
                             const RecordCoding& coding);

// A record whose structure has been checked.
struct SegmentRecord {
  std::vector<std::uint8_t> bytes;  // of all of it; empty: there is none
  std::uint64_t payload_at = 0;     // in the file
  LayoutSet own;                    // the layout, where it is the record's own
  std::uint16_t layout = 0;         // a number of the file's, or 0 of the record's own
  bool has_own = false;
  std::uint64_t checksum = 0;  // of the decoded planes
  std::uint64_t first_key = 0;
  std::vector<std::span<const std::uint8_t>> streams;  // by row of the layout; rANS: empty
  std::span<const std::uint8_t> group;

  const LayoutSet& set(const LayoutSet& of_file) const { return has_own ? own : of_file; }
  const Layout& layout_in(const LayoutSet& of_file) const { return set(of_file).layouts[layout]; }
};

// The records of a segment.
struct SegmentRecords {
  SegmentRecord base, harmonics;
  // Bytes that they and what is decoded from them take, never above the limit (conformance 1.5).
  std::uint64_t memory = 0;
};
// Reads and checks the records of segment `ordinal` of a file, within head.limits; its harmonics
// above degree 0 only where they are asked for and are a record of their own.
bool read_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                  bool with_harmonics, SegmentRecords& records, Findings& findings);

// The same as a decoder elsewhere takes them.
bool code_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                  CodedSegment& out, Findings& findings);

// Decodes all streams into `set`, whose arrays are made no larger than the bytes can fill, and
// checks that its primitives can be drawn (check_primitives).
bool decode_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                    Gaussians4D& set, Findings& findings);

}  // namespace stgs
