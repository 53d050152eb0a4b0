// SPDX-License-Identifier: Apache-2.0
// The container: header, records, metadata and index (spec 2 to 5, 9, 10).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "codec/layout.h"
#include "container/ends.h"
#include "container/findings.h"
#include "container/index.h"
#include "core/shared_value.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/scene_file.h"

namespace stgs {

// Any text-mode conversion damages its carriage return, line feeds or end-of-file (spec 2.1).
inline constexpr std::array<std::uint8_t, 8> kMagic = {0x89, 'S', 'T', 'G', 0x0D, 0x0A, 0x1A, 0x0A};
inline constexpr std::uint64_t kHeaderBytes = 32;
inline constexpr std::uint64_t kRecordHeaderBytes = 24;
inline constexpr std::uint32_t kCritical = 1;  // record flag, spec 3.1
// Greatest number of primitives per byte of a record (spec 5.5). Groups can have more (8192 take
// 128 bytes), so that a writer appends bytes.
inline constexpr std::uint64_t kMaxPrimitivesPerByte = 1;
inline constexpr std::uint32_t kCriticalHeaderFlags = 0xFFFF;  // spec 2.2
inline constexpr std::uint32_t kGrowing = 1, kHasEnds = 2;     // header flags, spec 2.1
// Recommended size of a head and of a node, bytes (spec 2.3, 5.2).
inline constexpr std::uint64_t kHeadTarget = 16384;
// The greatest number of links that follow each other (spec 5.2).
inline constexpr int kMaxLinkDepth = 8;

constexpr std::uint32_t tag_of(const char (&text)[5]) {
  std::uint32_t tag = 0;
  for (int i = 0; i < 4; ++i) tag |= std::uint32_t(static_cast<unsigned char>(text[i])) << (8 * i);
  return tag;
}
inline constexpr std::uint32_t kMetadataTag = tag_of("META");
inline constexpr std::uint32_t kLayoutTag = tag_of("LAYT");
inline constexpr std::uint32_t kIndexTag = tag_of("INDX");
inline constexpr std::uint32_t kPageTag = tag_of("PAGE");
inline constexpr std::uint32_t kSegmentTag = tag_of("SEGM");
inline constexpr std::uint32_t kFragmentTag = tag_of("FRAG");
inline constexpr std::uint32_t kCopyTag = tag_of("COPY");
inline constexpr std::uint32_t kWindowTag = tag_of("WNDW");
inline constexpr std::uint32_t kPrivateTag = tag_of("PRIV");
inline constexpr std::uint32_t kStepTag = tag_of("STEP");
inline constexpr std::uint32_t kErrorTag = tag_of("ERRB");
inline constexpr std::uint32_t kImportanceTag = tag_of("IMPO");

// Returns the CRC-32 of the bytes (spec 1.5). `before`: that of the bytes before them.
std::uint32_t checksum(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

struct FileHeader {
  std::uint16_t major = kFormatMajor, minor = kFormatMinor;
  std::uint32_t flags = 0;
  std::uint64_t file_bytes = 0;
  std::uint32_t head_bytes = 0;
};

struct RecordHeader {
  std::uint32_t tag = 0, flags = 0;
  std::uint64_t length = 0;    // of the payload
  std::uint32_t checksum = 0;  // of the payload
};

// The content of META (spec 4).
struct FileMetadata {
  SceneMetadata scene;
  Profile profile = Profile::kLossless;
  int sh_degree = 0;
  std::uint16_t profile_number = 0;  // as read
};

// The kind of a private number (spec 3.5).
enum class PrivateKind : std::uint16_t { kAttribute = 0, kProfile = 1, kContent = 2 };
// The owner's name of a private number.
struct PrivateName {
  PrivateKind kind = PrivateKind::kAttribute;
  std::uint16_t number = 0;
  std::string name;
};

// The last fragment of a growing file (spec 9).
struct LastFragment {
  std::uint64_t offset = 0, bytes = 0;  // of its FRAG record, including the record header
  std::uint32_t checksum = 0;           // of the record's payload
  std::uint32_t frames = 0;
  std::vector<NodeLink> earlier;  // links besides those of its node
  TickRange needed;               // times at which segments of its node, and below it, are needed
};

// Header, metadata, layouts, parts and index of a file.
struct FileHead {
  ReadLimits limits;  // limits of reading it
  FileHeader header;
  FileMetadata metadata;
  Shared<LayoutSet> layouts;
  std::optional<Quantisation> quantisation;  // STEP
  std::vector<ErrorBound> error_bounds;      // ERRB
  std::vector<PrivateName> private_names;
  std::vector<bool> named_numbers;  // by private_key() of a kind and number; empty: none is named
  std::vector<PartEntry> parts;
  FileIndex index;                                      // as far as it is loaded
  std::vector<std::shared_ptr<const LoadedEnds>> ends;  // likewise, in the order of loading
  IndexWalk walk;
  std::uint64_t listed_primitives = 0;       // of the segments in `index`
  std::vector<LostFragment> lost_fragments;  // content of damaged nodes
  bool closed = true;                        // nothing will be appended
  std::optional<LastFragment> last_fragment;
  std::uint64_t index_bytes = 0;            // bytes read: the head, and the nodes beyond it
  std::uint64_t available_bytes = 0;        // length of the source
  Shared<std::vector<std::uint8_t>> bytes;  // of the head, or of its copy
  bool repaired = false;                    // they are those of a copy

  // Returns whether a record lies within the source (spec 2.4). True for one of 0 bytes.
  bool has(const RecordRange& entry) const {
    return entry.bytes == 0 ||
           (entry.offset <= available_bytes && entry.bytes <= available_bytes - entry.offset);
  }
  bool growing() const { return (header.flags & kGrowing) != 0; }
  const SegmentEntry& segment(std::uint32_t number) const {
    return index.segments[number - index.first];
  }
  double chunk_of(std::uint32_t part) const { return parts[part].chunk_ticks; }
};

// Returns the interval of a segment, ticks from the beginning of its part (spec 5.4).
TickRange interval_of(const FileHead& head, const IndexEntry& entry, std::uint32_t part);
// Returns the times of the timeline at which a segment is needed; begin >= end: never.
TickRange needed_of(const FileHead& head, const SegmentEntry& segment);

// Reads a record of ends into head.ends. Damage of the record alone is reported, and the record is
// ignored (spec 10.1). Returns false if the source fails or a limit is exceeded.
bool load_ends(const ByteSource& source, const FurtherEntry& further, FileHead& head,
               Findings& findings);
// Returns the loaded ends of a segment, the earliest of each primitive, ascending by primitive.
std::vector<SegmentEnd> ends_of(const FileHead& head, const SegmentEntry& segment);

// Writing.

std::vector<std::uint8_t> write_header(const FileHeader& header);
// Returns header and payload of a record.
std::vector<std::uint8_t> write_record(std::uint32_t tag, std::span<const std::uint8_t> payload,
                                       std::uint32_t flags = kCritical);
std::vector<std::uint8_t> write_metadata(const FileMetadata& metadata);
std::vector<std::uint8_t> write_window(const CaptureWindow& window);
std::vector<std::uint8_t> write_steps(const Quantisation& rules);
std::vector<std::uint8_t> write_error_bounds(std::span<const ErrorBound> bounds);
// Writes the importances in the order of the file's primitives.
std::vector<std::uint8_t> write_importance(std::span<const float> importance,
                                           std::span<const std::uint32_t> order);
// Returns the head of a finished file with these records, whose COPY record is at `copy_at`.
// Sets the sizes of the header.
std::vector<std::uint8_t> write_finished_head(FileHeader header,
                                              std::span<const std::uint8_t> records,
                                              std::uint64_t copy_at);
// Returns the COPY record of a head (spec 10.2).
std::vector<std::uint8_t> write_head_copy(std::span<const std::uint8_t> head);
// Bytes of the COPY record of a head.
constexpr std::uint64_t head_copy_bytes(std::uint64_t head_bytes) {
  return kRecordHeaderBytes + head_bytes + 8;
}

// Reading. The functions below add problems to `findings` and return whether reading can continue.

// Parses a header; returns nothing if its magic or checksum is wrong.
std::optional<FileHeader> intact_header(std::span<const std::uint8_t> bytes);
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
bool parse_window(std::span<const std::uint8_t> payload, std::uint64_t offset,
                  SceneMetadata& metadata, Findings& findings);
// Checks that the window lies within its capture (spec 4.5). Otherwise reports damage and removes
// it.
void check_window(SceneMetadata& metadata, Findings& findings);
// Ignores steps that are not valid (spec annex D).
void parse_steps(std::span<const std::uint8_t> payload, FileHead& head);
bool parse_error_bounds(std::span<const std::uint8_t> payload, std::uint64_t offset, FileHead& head,
                        Findings& findings);
bool parse_private_names(std::span<const std::uint8_t> payload, std::uint64_t offset,
                         FileHead& head, Findings& findings);
// Checks for the validator that the owners of private numbers are named: in the payload of a
// private record, or in PRIV for attributes, profiles and contents.
void check_private_record(const RecordHeader& record, std::span<const std::uint8_t> payload,
                          std::uint64_t offset, Findings& findings);
void check_private_layouts(const LayoutSet& set, std::uint64_t offset, const FileHead& head,
                           Findings& findings);
void check_private_numbers(const FileHead& head, Findings& findings);

// Which damage of a head is reported.
enum class HeadDamage {
  kAny,      // of a header of a record, or of a payload
  kUnusable  // not of payloads of records that are not critical (spec 10.2, step 4)
};
// Returns whether records without such damage fill a head to its end. Reports the first damage.
bool is_intact_head(std::span<const std::uint8_t> head, HeadDamage which, Findings& findings);
// Returns whether a copy of a head can be used (spec 9.4, 10.2): its header and records are intact,
// it has the length that its header states, and it is of a growing file or of one of `file_bytes`.
bool is_usable_copy(std::span<const std::uint8_t> head, bool growing, std::uint64_t file_bytes);

// A copy of a damaged head.
struct HeadCopy {
  std::uint64_t offset = 0;        // of the record that contains it
  std::vector<std::uint8_t> head;  // empty if it exceeds the memory limit
};
// Finds an intact copy of a head, in COPY or in the last FRAG record; nothing if there is none.
Result<std::optional<HeadCopy>> find_head_copy(const ByteSource& source, const ReadLimits& limits);
// Checks that the COPY record at `at` is the last record of a finished file and a copy of its head.
void check_head_copy(const FileHead& head, std::uint64_t at, std::span<const std::uint8_t> payload,
                     Findings& findings);

// Reads and checks the head (spec 2.3), or its copy if it is damaged, and the index. Returns false
// if segments cannot be located.
bool read_head(const ByteSource& source, const ReadLimits& limits, IndexLoading loading,
               FileHead& head, Findings& findings);
// Loads the index as far as it concerns times of [t0, t1], ticks. Segments are added at the end.
// Returns false if the source fails or a limit is exceeded; then a part of the index is loaded.
bool load_index(const ByteSource& source, double t0, double t1, FileHead& head, Findings& findings);
// Loads more of the index until it has `entries` entries (IndexWalk::entries): first the nodes
// needed at `ticks` or soonest after it, then earlier ones. Otherwise as load_index().
bool load_ahead(const ByteSource& source, double ticks, std::uint64_t entries, FileHead& head,
                Findings& findings);
// Reads what was appended to a growing file since `head` was read. Segments are added at the end.
// Sets `grown` to whether there is a later fragment. Returns false also if the known last fragment
// is gone.
bool read_growth(const ByteSource& source, FileHead& head, bool& grown, Findings& findings);

// Returns a tag as text, such as "META", with dots for non-printable bytes.
std::string tag_text(std::uint32_t tag);
// Returns the number of floats of a decoded primitive.
std::uint64_t floats_per_primitive(int sh_degree);

}  // namespace stgs
