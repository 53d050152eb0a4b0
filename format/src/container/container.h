// SPDX-License-Identifier: Apache-2.0
// The container: header, records, metadata and index (spec 2 to 5).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "codec/layout.h"
#include "container/findings.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/scene_file.h"

namespace stgs {

// Any text-mode conversion damages its carriage return, line feeds or end-of-file (spec 2.1).
inline constexpr std::array<std::uint8_t, 8> kMagic = {0x89, 'S', 'T', 'G', 0x0D, 0x0A, 0x1A, 0x0A};
inline constexpr std::uint64_t kHeaderBytes = 40;
inline constexpr std::uint64_t kRecordHeaderBytes = 32;
inline constexpr std::uint32_t kCritical = 1;  // record flag, spec 3.2
// Greatest number of primitives per byte of a record (spec 5.5). rANS stays below it: a block of
// 2048 primitives takes at least 132 bytes.
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
inline constexpr std::uint32_t kQuantisationTag = tag_of("quan");  // private
inline constexpr std::uint32_t kFragmentTag = tag_of("FRAG");
inline constexpr std::uint32_t kCopyTag = tag_of("COPY");
// The minor version that introduced COPY, and fragments located by the records they list
// (spec 5.12).
inline constexpr std::uint16_t kCopyMinor = 1;

// Returns the XXH3-64 of the bytes, seed 0 (spec 1.5).
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

// The content of META (spec 4).
struct FileMetadata {
  SceneMetadata scene;
  Profile profile = Profile::kLossless;
  int sh_degree = 0;
  std::uint16_t profile_number = 0;  // as read
};

// The content of a record. Together with a tier of the segment it forms a layer (spec 5.7).
enum class Content : std::uint8_t {
  kPrimitives = 0,  // all attributes; SH above degree 0 may be in a record of their own
  kSh = 1,          // the SH above degree 0
};
inline constexpr int kMaxKnownContent = 1;
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
  std::uint64_t offset = 0, bytes = 0;  // of the SEGM record, including its header
  std::uint32_t primitives = 0;
};

// A segment of one tier: its base record, and the SH record if SH are stored separately.
struct SegmentEntry {
  IndexEntry base, sh;  // sh.bytes = 0: no SH record
  std::uint32_t part = 0;
};

// A part of the index (spec 5.3).
struct PartEntry {
  double begin = 0, end = 0;          // ticks
  std::uint64_t skip = 0;             // bytes between the previous part's records and its own
  std::optional<TickRange> cut = {};  // the shown times, if they are not the complete part
  double chunk_ticks = 0;             // 0: that of the index
};

// A record of unknown content in a segment, such as timed data (spec 5.13).
struct FurtherEntry {
  IndexEntry entry;
  std::uint32_t part = 0;
};

// Bytes spent on an attribute.
struct AttributeBytes {
  std::uint16_t attribute = 0;
  std::uint64_t bytes = 0;
};

struct FileIndex {
  double chunk_ticks = 0;
  std::uint64_t primitives = 0;
  std::vector<SegmentEntry> segments;
  std::vector<AttributeBytes> attributes;
  std::vector<FurtherEntry> further;  // in file order
};

// The kind of a private number (spec 3.5).
enum class PrivateKind : std::uint16_t { kAttribute = 0, kProfile = 1, kContent = 2 };
// The vendor's name of a private number.
struct PrivateName {
  PrivateKind kind = PrivateKind::kAttribute;
  std::uint16_t number = 0;
  std::string name;
};

// A chunk is a multiple of kChunkGrain and at most kMaxChunk, ticks, so that arithmetic on
// intervals is exact (spec 5.2).
inline constexpr double kChunkGrain = 0x1p-20, kMaxChunk = 0x1p32;
// Returns whether a chunk is valid.
bool is_chunk(double ticks);
// Returns the nearest valid chunk; 0 stays 0.
double to_chunk(double ticks);

// Returns whether a time is valid as an end of a part (spec 5.3).
bool is_valid_time(double ticks);
// Returns the beginning of a segment, ticks from the beginning of its part (spec 5.4).
double begin_of(int level, std::uint32_t slot, double chunk_ticks);
// Returns the interval of a segment, from the beginning of its part, which lasts `length`.
TickRange interval_of(int level, std::uint32_t slot, double chunk_ticks, double length);

std::vector<std::uint8_t> write_header(const FileHeader& header);
// Returns header and payload of a record.
std::vector<std::uint8_t> write_record(std::uint32_t tag, std::span<const std::uint8_t> payload,
                                       std::uint32_t flags = kCritical);
std::vector<std::uint8_t> write_metadata(const FileMetadata& metadata);
// The segments and the further records must be listed part after part.
std::vector<std::uint8_t> write_index(const FileIndex& index, std::span<const PartEntry> parts);
std::vector<std::uint8_t> write_window(const CaptureWindow& window);
// Writes the importances in the order of the file's primitives.
std::vector<std::uint8_t> write_importance(std::span<const float> importance,
                                           std::span<const std::uint32_t> order);
// Returns the payload of the record of Scene::quantisation.
std::vector<std::uint8_t> write_quantisation(const Quantisation& rules);
// Parses it. Returns nothing if it is of another program, or invalid.
std::optional<Quantisation> parse_quantisation(std::span<const std::uint8_t> payload);
// Returns the records of an index in file order (spec 5.6): the base records of all tiers of a
// segment, then their SH records.
std::vector<IndexEntry*> records_of(std::vector<SegmentEntry>& segments);

// The functions below add problems to `findings` and return whether reading can continue.

bool parse_header(std::span<const std::uint8_t> bytes, std::uint64_t source_bytes,
                  FileHeader& header, Findings& findings);
// `offset`: of `bytes` in the file; `area_end`: upper bound of the end of the payload.
bool parse_record_header(std::span<const std::uint8_t> bytes, std::uint64_t offset,
                         std::uint64_t area_end, RecordHeader& header, Findings& findings);
// Returns whether this version reads a record with these flags. Adds an error if the record can be
// neither read nor skipped. `offset`: of the record; `known_tag`: the tag is allowed here.
bool check_flags(const RecordHeader& header, bool known_tag, std::uint64_t offset,
                 Findings& findings);
// Returns the header of the record at `offset` if it is intact and the record ends before `end`.
Result<std::optional<RecordHeader>> complete_record_at(const ByteSource& source,
                                                       std::uint64_t offset, std::uint64_t end);
bool check_payload(const RecordHeader& header, std::span<const std::uint8_t> payload,
                   std::uint64_t offset, Findings& findings);
// Checks the values of META (spec 4.3); used by readers and writers.
void check_metadata_values(const FileMetadata& metadata, std::uint64_t offset, Findings& findings);
bool parse_metadata(std::span<const std::uint8_t> payload, std::uint64_t offset,
                    FileMetadata& metadata, Findings& findings);
// A FRAG record that the index was read from.
struct FragmentEntry {
  std::uint64_t offset = 0, bytes = 0;  // including the record header
  std::size_t first_part = 0;           // of the parts that it lists
  std::vector<AttributeBytes> before;   // totals of the preceding FRAG records
};
// Header, metadata, layouts, parts and index of a file.
struct FileHead {
  ReadLimits limits;  // limits of reading it
  FileHeader header;
  FileMetadata metadata;
  LayoutSet layouts;
  std::vector<PartEntry> parts;
  FileIndex index;
  bool closed = true;                 // nothing will be appended
  std::uint64_t index_bytes = 0;      // bytes read: the head, and the FRAG records
  std::uint64_t available_bytes = 0;  // length of the source
  std::uint64_t head_checksum = 0;
  std::vector<std::uint8_t> repaired;  // the head, if it was read from its copy
  std::vector<PrivateName> private_names;
  std::vector<FragmentEntry> fragments;      // of a growing file, in file order
  std::vector<LostFragment> lost_fragments;  // the same
  std::uint32_t unreached_frames = 0;        // frame count of an unusable later fragment; 0: none

  // Returns whether a record lies within the source (spec 2.6). True for an entry without a record.
  bool has(const IndexEntry& entry) const {
    return entry.bytes == 0 ||
           (entry.offset <= available_bytes && entry.bytes <= available_bytes - entry.offset);
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
// Checks for the validator that the vendors of private numbers are named: in the payload of a
// private record, or in PRIV for attributes, profiles and contents.
void check_private_record(const RecordHeader& record, std::span<const std::uint8_t> payload,
                          std::uint64_t offset, Findings& findings);
void check_private_layouts(const LayoutSet& set, std::uint64_t offset, const FileHead& head,
                           Findings& findings);
void check_private_numbers(const FileHead& head, Findings& findings);
// Memory charged for each entry of an index, and the number of entries free of charge (conformance
// 1.5).
inline constexpr std::uint64_t kEntryMemory = 512, kFreeEntries = 1024;
// The range of the file that contains the records of an index.
struct RecordArea {
  std::uint64_t begin = 0, end = 0;
};
// Adds to head.parts and head.index. Header and metadata must have been read. Call check_index()
// after the last part of the index.
bool parse_index(std::span<const std::uint8_t> payload, std::uint64_t offset,
                 const RecordArea& area, FileHead& head, Findings& findings);
void check_index(const FileHead& head, std::uint64_t offset, const ReadLimits& limits,
                 Findings& findings);
// The fields of a FRAG record before its part of the index (spec 5.12).
struct FragmentHeader {
  std::uint32_t frames = 0, flags = 0;
  float bounds_min[3] = {0, 0, 0}, bounds_max[3] = {0, 0, 0};
  std::uint64_t offset = 0;    // of the record itself
  std::uint64_t head = 0;      // checksum of the file's head
  std::uint64_t previous = 0;  // offset of the FRAG before the content this one lists; 0: none
  std::uint64_t before = 0;    // offset of the FRAG before this one; 0: none
};
// Checks the flags of the FRAG record at `offset`. `last`: it is the last one of the file.
bool check_fragment_flags(std::uint32_t flags, bool last, std::uint64_t offset, Findings& findings);
// Returns a FRAG record. `index`: the result of write_index().
std::vector<std::uint8_t> write_fragment(const FragmentHeader& header,
                                         std::span<const std::uint8_t> index);
// Reads the complete part of the index of a growing file whose head has been read, and sets
// header.file_bytes to its end.
bool read_fragments(const ByteSource& source, FileHead& head, Findings& findings);
// Checks that the window lies within its capture (spec 4.5). Otherwise reports damage and removes
// it.
void check_window(SceneMetadata& metadata, Findings& findings);
// Returns the interval of a segment, ticks from the beginning of its part (spec 5.4).
TickRange interval_of(const FileHead& head, const IndexEntry& entry, std::uint32_t part);
// Returns the times of the timeline at which a segment is shown; begin >= end: never.
TickRange shown_of(const FileHead& head, const SegmentEntry& segment);
// As above for an interval that counts from the beginning of a part with this range and cut.
TickRange shown_of(const TickRange& interval, const TickRange& part,
                   const std::optional<TickRange>& cut);
// Parses a header; returns nothing if its magic or checksum is wrong.
std::optional<FileHeader> intact_header(std::span<const std::uint8_t> bytes);
// Returns whether intact records fill a head to its end. Reports the first damaged one.
bool is_intact_head(std::span<const std::uint8_t> head, Findings& findings);
// Returns the bytes of a head that has been read.
Result<std::vector<std::uint8_t>> read_head_bytes(const ByteSource& source, const FileHead& head);

// A head and its COPY record (spec 3.6), which is the last record of the file or, in a growing
// file, the first one of the body.
struct CopiedHead {
  std::vector<std::uint8_t> head, copy;
};
// Returns a head with these records. Sets the sizes of the header; `body_bytes` is the length of
// the other records of a file that does not grow.
CopiedHead write_copied_head(FileHeader header, std::span<const std::uint8_t> records,
                             std::uint64_t body_bytes);

// Bytes of the length that ends the payload of a head copy.
inline constexpr std::uint64_t kHeadLengthBytes = 8;

struct HeadCopy {
  std::uint64_t offset = 0;        // of its record
  std::vector<std::uint8_t> head;  // the head that it is a copy of
};
// Finds the intact copy of a damaged head that begins with the kHeaderBytes `first`; nothing if
// there is none.
Result<std::optional<HeadCopy>> find_head_copy(const ByteSource& source,
                                               std::span<const std::uint8_t> first,
                                               const ReadLimits& limits);
// Returns the end of the COPY record at the beginning of a growing file's body; the beginning of
// the body if there is none.
Result<std::uint64_t> end_of_head_copy(const ByteSource& source, const FileHeader& header);
// Checks that the COPY record at `at` is a copy of the file's head.
void check_head_copy(const ByteSource& source, const FileHead& head, std::uint64_t at,
                     std::span<const std::uint8_t> payload, Findings& findings);

// Reads and checks the head (spec 2.3), or its copy if it is damaged. Returns false if segments
// cannot be located.
bool read_head(const ByteSource& source, const ReadLimits& limits, FileHead& head,
               Findings& findings);

// Returns a tag as text, such as "META", with dots for non-printable bytes.
std::string tag_text(std::uint32_t tag);
// Returns the number of floats of a decoded primitive.
std::uint64_t floats_per_primitive(int sh_degree);

}  // namespace stgs
