// SPDX-License-Identifier: Apache-2.0
// The payload of a SEGM record: its key, its layout and the bytes of its streams (spec 6.5).
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "codec/layout.h"
#include "container/container.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// The planes of a record in the order of its layout's streams.
struct RecordPlanes {
  std::size_t n = 0;                         // primitives
  std::array<std::uint32_t, kShBands> sh{};  // primitives with a degree of at least 1, 2 and 3
  std::uint32_t first_key = 0;
  std::vector<std::uint8_t> symbols;

  // Returns the symbols of a plane of this stream.
  std::size_t symbols_of(Attribute attribute) const {
    const int band = band_of(attribute);
    return band == 0 ? n : sh[static_cast<std::size_t>(band - 1)];
  }
};

// How a record is coded.
struct RecordCoding {
  const LayoutSet* set = nullptr;  // layouts and tables; not owned
  std::uint16_t layout = 0;        // of the record, in `set`
  bool own = false;                // `set` has this layout only and is written into the record
};
struct SegmentPayload {
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint64_t> stored;  // bytes of each stream that is not coded with rANS, else 0
};
SegmentPayload write_segment(const IndexEntry& entry, int sh_degree, const RecordPlanes& planes,
                             const RecordCoding& coding);

// A record whose structure has been checked.
struct SegmentRecord {
  std::vector<std::uint8_t> bytes;  // complete; empty if the record does not exist
  std::uint64_t payload_at = 0;     // offset in the file
  LayoutSet own;                    // the record's own layout, if has_own
  std::uint16_t layout = 0;         // number in the file's set, or 0 in `own`
  bool has_own = false;
  std::array<std::uint32_t, kShBands> sh{};  // primitives with a degree of at least 1, 2 and 3
  std::uint32_t first_key = 0;
  // The units (spec 6.5): their rows and bytes.
  struct Unit {
    Layout::Unit rows;
    std::span<const std::uint8_t> bytes;
  };
  std::vector<Unit> units;

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

// Reads a listed record and checks it against its entry. Returns false if it is unusable.
bool read_listed(const ByteSource& source, const FileHead& head, const IndexEntry& entry,
                 std::vector<std::uint8_t>& bytes, Findings& findings);

// A further record of a private content (spec 5.7).
struct FurtherRecord {
  TickRange times;   // closed; ticks from the beginning of the part
  std::string type;  // of the data: a media type or a private name
  std::vector<std::uint8_t> data;
};
// Reads and checks a further record. Data of reserved contents is not interpreted.
bool read_further(const ByteSource& source, const FileHead& head, const FurtherEntry& further,
                  FurtherRecord& out, Findings& findings);

// Converts the records for a decoder on another device.
bool code_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                  TimeOrigin origin, CodedSegment& out, Findings& findings);

// Decodes these attributes into `set`, whose arrays never grow beyond the size the bytes can fill,
// and validates the primitives (check_primitives()). Attributes that others depend on must be
// among them; arrays of the others are empty.
bool decode_segment(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                    AttributeBits attributes, TimeOrigin origin, Gaussians4D& set,
                    Findings& findings);

// Returns the work of decode_ranges(), as values that take as long: the floats, and the symbols of
// planes that are not constant, which count several times in blocks of few lanes. A position that
// Draco codes counts as kDracoWork; the checks of a primitive, a record, a plane, a table of an own
// layout and a plane that needs one have constants of their own.
std::uint64_t decoded_values(const SegmentRecords& records, const FileHead& head,
                             std::uint32_t ordinal);
inline constexpr std::uint64_t kDracoWork = 128, kRecordWork = 3584, kPlaneWork = 64,
                               kOwnTableWork = 96, kLookupWork = 1024, kPrimitiveWork = 32;

// The work that remains to a caller of decode_ranges().
struct DecodingWork {
  std::uint64_t values = 0;
  bool is_refused = false;  // a segment needs more: it and those after it are not decoded
  Gaussians4D window = {};  // memory that is used again for each segment
};

// Makes the checks of decode_segment() for all attributes, and returns the same, but decodes a
// range of primitives after the other: 4 MiB of them at a time, positions of Draco excepted.
// `visit` receives them with SH up to the greatest degree of the records and with time_origin as
// TimeOrigin::kRecord. Reduces `work` by decoded_values(), or refuses the segment with the error
// kMemoryLimit.
bool decode_ranges(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                   const RangeVisitor& visit, DecodingWork& work, Findings& findings);
// As decode_segment() for all attributes, but passes the primitives to `visit` range by range, with
// SH up to the greatest degree of the records.
bool pass_ranges(const SegmentRecords& records, const FileHead& head, std::uint32_t ordinal,
                 TimeOrigin origin, const RangeVisitor& visit, Findings& findings);

}  // namespace stgs
