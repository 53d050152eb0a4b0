// SPDX-License-Identifier: Apache-2.0
// The outer structure of a file: header, records, metadata, index (spec 2 to 5).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "findings.h"
#include "layout.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/scene_file.h"

namespace stgs {

// Carriage return, line feed, end-of-file and line feed break under any text conversion (spec 2.1).
inline constexpr std::array<std::uint8_t, 8> kMagic = {0x89, 'S', 'T', 'G', 0x0D, 0x0A, 0x1A, 0x0A};
inline constexpr std::uint64_t kHeaderBytes = 40;
inline constexpr std::uint64_t kRecordHeaderBytes = 32;
inline constexpr std::uint32_t kCritical = 1;  // record flag, spec 3.2
// The most primitives that a record has for each of its bytes (spec 5.5): rANS, whose blocks of
// 2048 take 132 bytes at least, stays below.
inline constexpr std::uint64_t kMaxPrimitivesPerByte = 16;
inline constexpr std::uint32_t kCriticalHeaderFlags = 0xFFFF;  // spec 2.4
inline constexpr std::uint32_t kGrowing = 1;                   // header flag, spec 2.4
inline constexpr std::uint32_t kFragmentClosed = 1;            // fragment flag, spec 5.12
inline constexpr std::uint32_t kCriticalFragmentFlags = 0xFFFF;

constexpr std::uint32_t tag_of(const char (&text)[5]) {
  std::uint32_t tag = 0;
  for (int i = 0; i < 4; ++i) tag |= std::uint32_t(static_cast<unsigned char>(text[i])) << (8 * i);
  return tag;
}
inline constexpr std::uint32_t kMetadataTag = tag_of("META");
inline constexpr std::uint32_t kIndexTag = tag_of("INDX");
inline constexpr std::uint32_t kSegmentTag = tag_of("SEGM");
inline constexpr std::uint32_t kWindowTag = tag_of("WNDW");
inline constexpr std::uint32_t kLayoutTag = tag_of("LAYT");
inline constexpr std::uint32_t kPrivateTag = tag_of("PRIV");
inline constexpr std::uint32_t kImportanceTag = tag_of("IMPO");
inline constexpr std::uint32_t kFragmentTag = tag_of("FRAG");
inline constexpr std::uint32_t kCopyTag = tag_of("COPY");
// The version of the format that has it, and finds a fragment by what it lists (spec 5.12).
inline constexpr std::uint16_t kCopyMinor = 1;

// XXH3-64, seed 0 (spec 1.5).
std::uint64_t checksum(std::span<const std::uint8_t> bytes);

struct FileHeader {
  std::uint16_t major = kFormatMajor, minor = kFormatMinor;
  std::uint32_t flags = 0;
  std::uint64_t file_bytes = 0, head_bytes = 0;
};

struct RecordHeader {
  std::uint32_t tag = 0, flags = 0;
  std::uint64_t length = 0, checksum = 0;  // of the payload
};

// Everything that META holds (spec 4).
struct FileMetadata {
  SceneMetadata scene;
  Profile profile = Profile::kLossless;
  int sh_degree = 0;
  std::uint16_t profile_number = 0;  // as it was read
};

// A layer is what a record brings, and for which tier of a segment's primitives (spec 5.7).
enum class Content : std::uint8_t {
  kPrimitives = 0,  // all attributes; the harmonics above degree 0 may be left to the next
  kHarmonics = 1,
};
inline constexpr int kLastContent = 1;            // that this version knows
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

// One record that the index lists (spec 5.3).
struct IndexEntry {
  std::int16_t level = 0;
  std::uint16_t layer = 0;  // content and tier (spec 5.7)
  std::uint32_t slot = 0;
  std::uint64_t offset = 0, bytes = 0;  // of the whole SEGM record
  std::uint32_t primitives = 0;
};

// A segment of a tier: the record of its primitives, and where there is one that of the harmonics
// that the former leaves out.
struct SegmentEntry {
  IndexEntry base, harmonics;  // harmonics.bytes = 0: there is no such record
  std::uint32_t part = 0;
};

// A part of the index (spec 5.3).
struct PartEntry {
  double begin = 0, end = 0;          // ticks
  std::uint64_t skip = 0;             // bytes between the records of the part before and its own
  std::optional<TickRange> cut = {};  // what of it is shown, where that is not all
  double chunk_ticks = 0;             // its own; 0: the index's
};

// A further record of a segment (spec 5.13).
struct FurtherEntry {
  IndexEntry entry;
  std::uint32_t part = 0;
};

struct AttributeBytes {
  std::uint16_t attribute = 0;
  std::uint64_t bytes = 0;
};

struct FileIndex {
  double chunk_ticks = 0;
  std::uint64_t primitives = 0;
  std::vector<SegmentEntry> segments;
  std::vector<AttributeBytes> attributes;
  std::vector<FurtherEntry> further;  // of contents that this version does not know, in file order
};

// Whose a private number is (spec 3.5).
enum class PrivateKind : std::uint16_t { kAttribute = 0, kProfile = 1, kContent = 2 };
struct PrivateName {
  PrivateKind kind = PrivateKind::kAttribute;
  std::uint16_t number = 0;
  std::string name;
};

// A chunk must be a multiple of this, ticks, and at most kMostChunk, so that all arithmetic on
// intervals is exact (spec 5.2).
inline constexpr double kChunkGrain = 0x1p-20, kMostChunk = 0x1p32;
bool is_chunk(double ticks);
// The nearest chunk; 0 stays.
double to_chunk(double ticks);

// [begin, end) in ticks.
struct Interval {
  double begin = 0, end = 0;
};
// Whether a moment of a part can be one (spec 5.3).
bool is_moment(double ticks);
// Where a place begins, from the beginning of its part on (spec 5.4).
double begin_of(int level, std::uint32_t slot, double chunk_ticks);
// The interval of a place from the beginning of its part on, which lasts `length`.
Interval interval_of(int level, std::uint32_t slot, double chunk_ticks, double length);

std::vector<std::uint8_t> write_header(const FileHeader& header);
// Header and payload of a record.
std::vector<std::uint8_t> write_record(std::uint32_t tag, std::span<const std::uint8_t> payload,
                                       std::uint32_t flags = kCritical);
std::vector<std::uint8_t> write_metadata(const FileMetadata& metadata);
// The segments and the further records are listed part after part.
std::vector<std::uint8_t> write_index(const FileIndex& index, std::span<const PartEntry> parts);
std::vector<std::uint8_t> write_window(const CaptureWindow& window);
// The importances in the order of the file's primitives.
std::vector<std::uint8_t> write_importance(std::span<const float> importance,
                                           std::span<const std::uint32_t> order);
// The records of an index in the order of the file (spec 5.6): those of a place tier after tier,
// then their harmonics.
std::vector<IndexEntry*> records_of(std::vector<SegmentEntry>& segments);

// Each parser reports what is wrong and returns whether its result can be used for going on.
bool parse_header(std::span<const std::uint8_t> bytes, std::uint64_t source_bytes,
                  FileHeader& header, Findings& findings);
// `offset` is where `bytes` begin in the file; `area_end` where the payload must end at the latest.
bool parse_record_header(std::span<const std::uint8_t> bytes, std::uint64_t offset,
                         std::uint64_t area_end, RecordHeader& header, Findings& findings);
// Whether this version reads a record of these flags; reports what may be neither read nor skipped.
// `offset` is the record's. `known_tag`: the tag is one that may stand here.
bool check_flags(const RecordHeader& header, bool known_tag, std::uint64_t offset,
                 Findings& findings);
// The header of a record that lies whole before `end`, if it is right.
Result<std::optional<RecordHeader>> whole_record_at(const ByteSource& source, std::uint64_t offset,
                                                    std::uint64_t end);
bool check_payload(const RecordHeader& header, std::span<const std::uint8_t> payload,
                   std::uint64_t offset, Findings& findings);
// What META must hold beyond its layout (spec 4.3): a writer checks it too.
void check_metadata_values(const FileMetadata& metadata, std::uint64_t offset, Findings& findings);
bool parse_metadata(std::span<const std::uint8_t> payload, std::uint64_t offset,
                    FileMetadata& metadata, Findings& findings);
// One of the FRAG records that the index was read from.
struct FragmentEntry {
  std::uint64_t offset = 0, bytes = 0;  // of the whole record
  std::size_t first_part = 0;           // of the parts that it lists
  std::vector<AttributeBytes> before;   // the totals of those before it
};
// Header, metadata, layouts, parts and index of a file.
struct FileHead {
  ReadLimits limits;  // that it was read under
  FileHeader header;
  FileMetadata metadata;
  LayoutSet layouts;
  std::vector<PartEntry> parts;
  FileIndex index;
  bool closed = true;                 // nothing more will be appended
  std::uint64_t index_bytes = 0;      // that were read: the head, and what there is of FRAG
  std::uint64_t available_bytes = 0;  // bytes of the file that there are
  std::uint64_t head_checksum = 0;
  std::vector<std::uint8_t> repaired;  // the head, where it was read from its copy
  std::vector<PrivateName> private_names;
  std::vector<FragmentEntry> fragments;  // of a growing file, in the order of the file
  std::vector<LostFragment> lost;        // the same
  std::uint32_t unreached_frames = 0;    // of a fragment behind the last complete one

  // Whether a record is there (spec 2.6), if it is one.
  bool has(const IndexEntry& entry) const {
    return entry.bytes == 0 || (entry.offset <= there && entry.bytes <= there - entry.offset);
  }
  bool growing() const { return (header.flags & kGrowing) != 0; }
  double chunk_of(std::uint32_t part) const {
    return parts[part].chunk_ticks > 0 ? parts[part].chunk_ticks : index.chunk_ticks;
  }
};
bool parse_window(std::span<const std::uint8_t> payload, std::uint64_t offset,
                  SceneMetadata& metadata, Findings& findings);
bool parse_private_names(std::span<const std::uint8_t> payload, std::uint64_t offset,
                         FileHead& head, Findings& findings);
// What a validator sees of private numbers: that their makers are named, in the payload of a
// record, or in PRIV for the attributes of layouts and for the rest.
void check_private_record(const RecordHeader& record, std::span<const std::uint8_t> payload,
                          std::uint64_t offset, Findings& findings);
void check_private_layouts(const LayoutSet& set, std::uint64_t offset, const FileHead& head,
                           Findings& findings);
void check_private_numbers(const FileHead& head, Findings& findings);
// What each entry of an index counts of the limit of memory, and how many do not (conformance 1.5).
inline constexpr std::uint64_t kEntryMemory = 512, kFreeEntries = 1024;
// Where the records of an index lie in the file.
struct RecordArea {
  std::uint64_t begin = 0, end = 0;
};
// Adds to head.parts and head.index; header and metadata are there. check_index comes after the
// last.
bool parse_index(std::span<const std::uint8_t> payload, std::uint64_t offset,
                 const RecordArea& area, FileHead& head, Findings& findings);
void check_index(const FileHead& head, std::uint64_t offset, const ReadLimits& limits,
                 Findings& findings);
// What a FRAG record tells beside its part of the index (spec 5.12).
struct FragmentHeader {
  std::uint32_t frames = 0, flags = 0;
  float bounds_min[3] = {0, 0, 0}, bounds_max[3] = {0, 0, 0};
  std::uint64_t offset = 0;    // its own
  std::uint64_t head = 0;      // checksum of the file's head
  std::uint64_t previous = 0;  // offset of the record before what this one lists; 0: there is none
  std::uint64_t before = 0;    // offset of the record before this one; 0: there is none
};
// The flags of a FRAG record at `offset`; `last`: it is the last of the file.
bool check_fragment_flags(std::uint32_t flags, bool last, std::uint64_t offset, Findings& findings);
// A FRAG record; `index` is what write_index() gives.
std::vector<std::uint8_t> write_fragment(const FragmentHeader& header,
                                         std::span<const std::uint8_t> index);
// The index of a growing file whose head is read, as far as it is complete; header.file_bytes is
// then where that ends.
bool read_fragments(const ByteSource& source, FileHead& head, Findings& findings);
// That the window lies in its capture (spec 4.5): else it is damage, and there is no window.
void check_window(SceneMetadata& metadata, Findings& findings);
// The interval of a segment from the beginning of its part on (spec 5.4).
Interval interval_of(const FileHead& head, const IndexEntry& entry, std::uint32_t part);
// The moments of the timeline at which a segment is shown; begin >= end: none.
Interval shown_of(const FileHead& head, const SegmentEntry& segment);
// The same of what is alive in a part, from its beginning on, where the part and its cut are known.
Interval shown_of(const Interval& alive, const Interval& part, const std::optional<TickRange>& cut);
// The fields of a header whose magic and checksum are right.
std::optional<FileHeader> intact_header(std::span<const std::uint8_t> bytes);
// Whether records fill a head to its end and have right checksums; reports the first that is not
// so.
bool is_whole_head(std::span<const std::uint8_t> head, Findings& findings);
// The bytes of a head that has been read.
Result<std::vector<std::uint8_t>> read_head_bytes(const ByteSource& source, const FileHead& head);

// A head, and the COPY record of it (spec 3.6) that ends the file or, where it grows, is the first
// of its body.
struct CopiedHead {
  std::vector<std::uint8_t> head, copy;
};
// Of these records and, where the file does not grow, before so many bytes of other records; sets
// the header's sizes.
CopiedHead write_copied_head(FileHeader header, std::span<const std::uint8_t> records,
                             std::uint64_t body_bytes);
struct HeadCopy {
  std::uint64_t offset = 0;        // of its record
  std::vector<std::uint8_t> head;  // that it stands for
};
// The copy of a damaged head that begins with `first`, kHeaderBytes; nothing where there is no
// right one.
Result<std::optional<HeadCopy>> find_head_copy(const ByteSource& source,
                                               std::span<const std::uint8_t> first,
                                               const ReadLimits& limits);
// Where the COPY record ends that a growing file's body begins with; where the body begins if there
// is none.
Result<std::uint64_t> end_of_head_copy(const ByteSource& source, const FileHeader& header);
// That the payload of the COPY record at `at` stands for the file's head.
void check_head_copy(const ByteSource& source, const FileHead& head, std::uint64_t at,
                     std::span<const std::uint8_t> payload, Findings& findings);

// Reads and checks the head (spec 2.3), or its copy; false where the segments cannot be reached.
bool read_head(const ByteSource& source, const ReadLimits& limits, FileHead& head,
               Findings& findings);

// "META", with bytes that are not printable as dots.
std::string tag_text(std::uint32_t tag);
// Floats of a decoded primitive.
std::uint64_t floats_per_primitive(int sh_degree);

}  // namespace stgs
