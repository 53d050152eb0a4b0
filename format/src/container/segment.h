// SPDX-License-Identifier: Apache-2.0
// The payload of a SEGM record: its key, its layout and the bytes of its streams (spec 6).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "codec/layout.h"
#include "container/container.h"

namespace stgs {

// The planes of a record's primitives in the order of its layout's streams, n symbols each.
struct RecordPlanes {
  std::size_t n = 0;
  std::uint64_t first_key = 0;
  std::vector<std::uint8_t> symbols;
};

// How a record is coded.
struct RecordCoding {
  const LayoutSet* set = nullptr;  // layouts and tables; not owned
  std::uint16_t layout = 0;        // of the record, in `set`
  bool own = false;                // `set` has this layout only and is written into the record
  int zstd_level = 9;
};
struct SegmentPayload {
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint64_t> stored;  // bytes of each stream; 0 if it is coded with rANS
};
SegmentPayload write_segment(const IndexEntry& entry, const RecordPlanes& planes,
                             const RecordCoding& coding);

// A record whose structure has been checked.
struct SegmentRecord {
  std::vector<std::uint8_t> bytes;  // complete; empty if the record does not exist
  std::uint64_t payload_at = 0;     // offset in the file
  LayoutSet own;                    // the record's own layout, if has_own
  std::uint16_t layout = 0;         // number in the file's set, or 0 in `own`
  bool has_own = false;
  std::uint64_t checksum = 0;  // of the decoded planes
  std::uint64_t first_key = 0;
  std::vector<std::span<const std::uint8_t>> streams;  // by row of the layout; empty for rANS
  std::span<const std::uint8_t> group;

  const LayoutSet& set(const LayoutSet& of_file) const { return has_own ? own : of_file; }
  const Layout& layout_in(const LayoutSet& of_file) const { return set(of_file).layouts[layout]; }
};

// The records of a segment.
struct SegmentRecords {
  SegmentRecord base, sh;
  // Memory of the records and of their decoded content, within the limit (conformance 1.5).
  std::uint64_t memory = 0;
};
// Reads and checks the records of segment `ordinal`, within head.limits. A separate SH record is
// read only with `with_sh`.
bool read_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                  bool with_sh, SegmentRecords& records, Findings& findings);

// Converts the records for a decoder on another device.
bool code_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                  CodedSegment& out, Findings& findings);

// Decodes all streams into `set`, whose arrays never grow beyond the size the bytes can fill, and
// validates the primitives (check_primitives()).
bool decode_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                    Gaussians4D& set, Findings& findings);

}  // namespace stgs
