// SPDX-License-Identifier: Apache-2.0
// Reading the header and the records of the head (spec 2, 3, 10.2).
#include <algorithm>
#include <limits>
#include <set>
#include <string_view>

#include "container/foreign_content.h"
#include "container/node.h"
#include "container/opening.h"
#include "core/read_bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

// The records of the head that are not critical.
constexpr std::uint32_t kOptionalTags[] = {kWindowTag, kPrivateTag, kStepTag, kErrorTag};

// Reads the payload of a record of the head that is critical, or one of kOptionalTags.
void read_record(std::uint32_t tag, std::span<const std::uint8_t> payload, std::uint64_t payload_at,
                 const ReadLimits& limits, FileHead& out, Findings& findings) {
  if (tag == kMetadataTag) (void)parse_metadata(payload, payload_at, out.metadata, findings);
  if (tag == kWindowTag) (void)parse_window(payload, payload_at, out.metadata.scene, findings);
  if (tag == kPrivateTag) (void)parse_private_names(payload, payload_at, out, findings);
  if (tag == kStepTag) parse_steps(payload, out);
  if (tag == kErrorTag) (void)parse_error_bounds(payload, payload_at, out, findings);
  if (tag == kLayoutTag) {
    ByteReader in(payload);
    LayoutSet& set = out.layouts.edit();
    (void)parse_layouts(in, payload_at, kMaxTables, kMaxLayouts,
                        std::min(limits.max_memory, opening_limit(out, 0)), set, findings);
    make_lookups(set);  // also after an error: the validator continues with the layouts before it
  }
  if (tag == kIndexTag) (void)parse_index(payload, payload_at, out, findings);
}

// Reads the records of the head.
bool walk_head(const ReadLimits& limits, FileHead& out, Findings& findings) {
  const std::span<const std::uint8_t> head = *out.bytes;
  std::set<std::uint32_t> have;
  for (std::uint64_t at = kHeaderBytes; at < head.size();) {
    RecordHeader record;
    if (!parse_record_header(head.subspan(at), at, head.size(), record, findings)) return false;
    const std::uint64_t record_at = at, payload_at = at + kRecordHeaderBytes;
    const auto payload = head.subspan(payload_at, record.length);
    at = payload_at + record.length;
    const bool known = record.tag == kMetadataTag || record.tag == kLayoutTag ||
                       (record.tag == kIndexTag && !out.growing());
    const bool optional =
        std::count(std::begin(kOptionalTags), std::end(kOptionalTags), record.tag) > 0 &&
        record.flags == 0;
    const bool used = optional || check_flags(record, known, record_at, findings);
    Findings found;
    if (check_payload(record, payload, payload_at, found) && used) {
      if (!have.insert(record.tag).second) {
        found.error(N::kDuplicateRecord, payload_at, "duplicate '{}' record", tag_text(record.tag));
      } else if (record.tag == kIndexTag && have.count(kMetadataTag) == 0) {
        found.error(N::kMissingRecord, payload_at, "the head has no META record before INDX");
      } else {
        read_record(record.tag, payload, payload_at, limits, out, found);
        if (!optional && !found.ok()) have.erase(record.tag);
      }
    }
    if ((record.flags & kCritical) == 0) {
      findings.damage(std::move(found));
    } else {
      findings.append(std::move(found));
    }
  }
  if (have.count(kMetadataTag) != 0 && (have.count(kIndexTag) != 0 || out.growing())) return true;
  if (findings.ok()) {
    findings.error(N::kMissingRecord, kHeaderBytes, "the head has no '{}' record",
                   have.count(kMetadataTag) != 0 ? "INDX" : "META");
  }
  return false;
}

}  // namespace

std::uint64_t floats_per_primitive(int sh_degree) {
  return 17 + 3 * static_cast<std::uint64_t>((sh_degree + 1) * (sh_degree + 1));
}

namespace {

// A growing file does not state its size (spec 2.1).
bool parse_growing_sizes(std::uint64_t source_bytes, const FileHeader& header, Findings& findings) {
  if (header.file_bytes != 0 || header.head_bytes < kHeaderBytes) {
    findings.error(N::kHeadSize, 16,
                   "invalid sizes in the header of a growing file (file: {} bytes, head: {} bytes)",
                   header.file_bytes, header.head_bytes);
    return false;
  }
  if (header.head_bytes <= source_bytes) return true;
  findings.error(N::kFileSize, 24,
                 "the file is truncated (its head has {} bytes, the file has {} bytes)",
                 header.head_bytes, source_bytes);
  return false;
}

bool parse_finished_sizes(std::uint64_t source_bytes, const FileHeader& header,
                          Findings& findings) {
  if (header.file_bytes < source_bytes) {
    findings.damage(N::kFileSize, 16,
                    "extra bytes after the end of the file (expected {} bytes, got {}); copy or "
                    "download it again",
                    header.file_bytes, source_bytes);
  }
  if (header.head_bytes < kHeaderBytes || header.head_bytes > header.file_bytes) {
    findings.error(N::kHeadSize, 24, "invalid head size ({} bytes in a file of {} bytes)",
                   header.head_bytes, header.file_bytes);
    return false;
  }
  if (header.head_bytes <= source_bytes) return true;
  findings.error(N::kFileSize, 16,
                 "the file is truncated within its head (expected {} bytes, got {}); copy or "
                 "download it again",
                 header.file_bytes, source_bytes);
  return false;
}

// Checks that these are at least as many bytes as a header, and begin with the magic number.
bool check_magic(std::span<const std::uint8_t> bytes, Findings& findings) {
  if (bytes.size() < kHeaderBytes) {
    const std::string content = describe_foreign_content(bytes);
    findings.error(
        N::kTooShort, 0, "too short for an .stgs file (expected at least {} bytes, got {}); {}",
        kHeaderBytes, bytes.size(), content.empty() ? "copy or download it again" : content);
    return false;
  }
  if (std::equal(kMagic.begin(), kMagic.end(), bytes.begin())) return true;
  const bool text_damage = std::equal(kMagic.begin(), kMagic.begin() + 4, bytes.begin());
  if (text_damage) {
    findings.error(N::kMagic, 0, "damaged by a text-mode transfer; copy the file in binary mode");
  } else {
    const std::string content = describe_foreign_content(bytes);
    findings.error(N::kMagic, 0, "not an .stgs file; {}",
                   content.empty() ? "its content is unknown; check the name" : content);
  }
  return false;
}

// Checks version and flags of an intact header.
bool check_version(const FileHeader& header, Findings& findings) {
  if (header.major != kFormatMajor) {
    const bool early = header.major == 0;
    findings.unsupported(
        N::kVersion, 8, "unsupported format version (expected {}.x, got {}{}.{}); {}", kFormatMajor,
        early ? "the pre-release version " : "", header.major, header.minor,
        early ? "create the file again with 'stgs train', 'pack' or 'convert'"
              : "use a later version of this program");
    return false;
  }
  if ((header.flags & kCriticalHeaderFlags & ~(kGrowing | kHasEnds)) == 0) return true;
  findings.unsupported(N::kHeaderFlags, 12, "file header has unknown critical flags {:#x}",
                       header.flags & kCriticalHeaderFlags);
  return false;
}

// Returns whether a file begins as one of format 1.x does, whose header has another checksum.
bool is_format_1(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= kHeaderBytes && std::equal(kMagic.begin(), kMagic.end(), bytes.begin()) &&
         ByteReader(bytes.subspan(kMagic.size())).u16() == 1;
}

}  // namespace

std::optional<FileHeader> intact_header(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kHeaderBytes || !std::equal(kMagic.begin(), kMagic.end(), bytes.begin())) {
    return {};
  }
  ByteReader in(bytes.subspan(kMagic.size()));
  FileHeader header;
  header.major = in.u16();
  header.minor = in.u16();
  header.flags = in.u32();
  header.file_bytes = in.u64();
  header.head_bytes = in.u32();
  if (in.u32() != checksum(bytes.first(kHeaderBytes - 4))) return {};
  return header;
}

bool parse_header(std::span<const std::uint8_t> bytes, std::uint64_t source_bytes,
                  FileHeader& header, Findings& findings) {
  if (!check_magic(bytes, findings)) return false;
  if (is_format_1(bytes)) {
    findings.unsupported(N::kVersion, 8,
                         "unsupported format version (expected {}.x, got 1.x); use 'stgs convert' "
                         "first",
                         kFormatMajor);
    return false;
  }
  const std::optional<FileHeader> fields = intact_header(bytes);
  if (!fields) {
    findings.error(N::kHeaderChecksum, 28, "file header is damaged (checksum mismatch)");
    return false;
  }
  header = *fields;
  if (!check_version(header, findings)) return false;
  return (header.flags & kGrowing) != 0 ? parse_growing_sizes(source_bytes, header, findings)
                                        : parse_finished_sizes(source_bytes, header, findings);
}

namespace {

// Reports a truncated file whose head is complete: the segments up to its end are available (spec
// 2.4).
void report_truncation(const FileHead& head, Findings& findings) {
  std::size_t missing = 0, without_sh = 0;
  for (const SegmentEntry& segment : head.index.segments) {
    missing += head.has(segment.base) ? 0 : 1;
    without_sh += head.has(segment.base) && !head.has(segment.sh) ? 1 : 0;
  }
  findings.damage(
      N::kFileSize, 16,
      "the file is truncated (expected {} bytes, got {}): {} of {} tiers of segments missing, {} "
      "without their SH; copy or download it again",
      head.header.file_bytes, head.available_bytes, missing, head.index.segments.size(),
      without_sh);
}

// Reads the head that the header states.
bool read_stated_head(const ByteSource& source, const ReadLimits& limits, FileHead& head,
                      Findings& findings) {
  if (!parse_header(*head.bytes, source.size(), head.header, findings)) return false;
  if (head.header.head_bytes > limits.max_memory) {
    findings.unsupported(N::kMemoryLimit, 24,
                         "head of {} bytes exceeds the memory limit of {} bytes",
                         head.header.head_bytes, limits.max_memory);
    return false;
  }
  std::vector<std::uint8_t>& bytes = head.bytes.edit();
  const Status status = read_bytes(source, 0, head.header.head_bytes, bytes);
  if (!status.ok()) findings.failed_read(0, status);
  return status.ok();
}

// Returns whether a copy of the head may repair this error of reading it (spec 10.2).
bool is_damage(const Findings& found) {
  const int number = Findings(found).take().back().number;
  return number == static_cast<int>(N::kTooShort) || number == static_cast<int>(N::kMagic) ||
         number == static_cast<int>(N::kHeaderChecksum) || number == static_cast<int>(N::kFileSize);
}

// Reads the bytes of the head or, if they are damaged, those of an intact copy.
bool read_or_repair(const ByteSource& source, const ReadLimits& limits, FileHead& head,
                    Findings& findings) {
  std::vector<std::uint8_t>& bytes = head.bytes.edit();
  bytes.resize(std::min<std::uint64_t>(kHeaderBytes, source.size()));
  if (Status status = source.read(0, bytes); !status.ok()) {
    findings.failed_read(0, status);
    return false;
  }
  const std::vector<std::uint8_t> first = bytes;
  if (first.size() == kHeaderBytes &&
      !std::equal(kMagic.begin(), kMagic.end(), first.begin())) {  // for the message
    bytes.resize(std::min<std::uint64_t>(kForeignBytes, source.size()));
    if (!source.read(0, bytes).ok()) bytes = first;
  }
  Findings found;
  const bool read = read_stated_head(source, limits, head, found);
  Findings damage;
  Result<std::optional<HeadCopy>> copy = std::optional<HeadCopy>();
  if (read ? !is_intact_head(bytes, HeadDamage::kAny, damage) : is_damage(found))
    copy = find_head_copy(source, limits);
  if (!copy.ok()) {
    findings.failed_search(0, copy.status());
    return false;
  }
  if (!*copy) {  // the caller reports the damage
    findings.append(std::move(found));
    return read && is_intact_head(bytes, HeadDamage::kUnusable, findings);
  }
  if ((*copy)->head.empty()) {
    findings.unsupported(N::kMemoryLimit, (*copy)->offset,
                         "head exceeds the memory limit of {} bytes", limits.max_memory);
    return false;
  }
  const Issue why = (read ? damage : found).take().front();
  findings.damage(
      N::kRepairedHead, why.offset,
      "head is damaged and was read from its copy at byte {} (issue {}: {}); copy or download the "
      "file again, or repair it with 'stgs finalize'",
      (*copy)->offset, why.number, why.message);
  bytes = std::move((*copy)->head);
  head.repaired = true;
  return parse_header(bytes, source.size(), head.header, findings);
}

// Sorts a completely loaded index.
void sort(FileHead& head) {
  sort_index(head.parts, head.index);
  for (std::uint32_t p = 0; p < head.parts.size(); ++p) head.walk.parts[head.parts[p]] = p;
  std::sort(head.lost_fragments.begin(), head.lost_fragments.end(),
            [](const LostFragment& a, const LostFragment& b) { return a.offset < b.offset; });
}

}  // namespace

bool read_head(const ByteSource& source, const ReadLimits& limits, IndexLoading loading,
               FileHead& head, Findings& findings) {
  head.limits = limits;
  head.available_bytes = source.size();
  if (!read_or_repair(source, limits, head, findings)) return false;
  head.index_bytes = head.header.head_bytes;
  if (!walk_head(limits, head, findings)) return false;
  if (head.growing()) {
    head.closed = false;
    bool grown = false;
    if (!read_growth(source, head, grown, findings)) return false;
  }
  if (loading == IndexLoading::kComplete) {
    constexpr double kAlways = std::numeric_limits<double>::infinity();
    if (!load_index(source, -kAlways, kAlways, head, findings)) return false;
    sort(head);
  }
  check_window(head.metadata.scene, findings);
  if (!head.growing() && head.available_bytes < head.header.file_bytes)
    report_truncation(head, findings);
  return true;
}

}  // namespace stgs
