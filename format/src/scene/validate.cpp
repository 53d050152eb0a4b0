// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <set>

#include "codec/values.h"
#include "container/node.h"
#include "container/segment.h"
#include "quantise/segmenter.h"
#include "scene/validate_index.h"

namespace stgs {
namespace {

using N = IssueNumber;
constexpr double kIntervalTolerance = 0.01;  // ticks, spec 5.8

void check_values(const Gaussians4D& set, const FileHead& head, std::uint32_t segment,
                  Findings& findings) {
  const SegmentEntry& entry = head.index.segments[segment];
  const SceneMetadata& scene = head.metadata.scene;
  const std::uint64_t at = entry.base.offset;
  const std::size_t n = set.size();
  const TickRange interval = interval_of(head, entry.base, entry.part);
  const PartEntry& part = head.parts[entry.part];
  check_each(n, N::kOutsideSegment, true, segment, at, "visible outside the segment's interval",
             findings, [&](std::size_t i) {
               const Lifetime lifetime = lifetime_of(set, i, part.end - part.begin, false);
               return !lifetime.never && (lifetime.begin < interval.begin - kIntervalTolerance ||
                                          lifetime.end > interval.end + kIntervalTolerance);
             });
  check_each(n, N::kOutsideBounds, false, segment, at, "position outside the stated bounds",
             findings, [&](std::size_t i) {
               bool outside = false;
               for (std::size_t axis = 0; axis < 3; ++axis) {
                 const float x = set.position[3 * i + axis];
                 outside |= x < scene.bounds_min[axis] || x > scene.bounds_max[axis];
               }
               return outside;
             });
}

// Returns whether the payload of a record, all of which is read, is within the caller's limit.
bool fits_memory(const RecordHeader& record, const FileHead& head, std::uint64_t at,
                 Findings& findings) {
  if (record.length <= head.limits.max_memory) return true;
  findings.unsupported(N::kMemoryLimit, at,
                       "record '{}' of {} bytes exceeds the memory limit of {} bytes",
                       tag_text(record.tag), record.length, head.limits.max_memory);
  return false;
}

// What is known about the records of a body.
struct Walk {
  const std::set<std::uint64_t>& copies;  // offsets of the copies of nodes
  std::uint32_t frames = 0;               // that the last FRAG record stated
};

// Checks a FRAG record that may be one of the index (spec 9.2).
void check_fragment(std::span<const std::uint8_t> payload, const FileHead& head, std::uint64_t at,
                    Walk& walk, Findings& findings) {
  ByteReader in(payload);
  if (in.u64() != at || !in.ok()) return;
  const std::uint32_t now = in.u32(), flags = in.u32();
  if (!in.ok()) return;
  if ((flags & kFragmentClosed) != 0 && head.last_fragment && at != head.last_fragment->offset) {
    findings.error(N::kFragment, at, "fragment marked as the last one is followed by others");
  }
  if (now < walk.frames) {
    findings.error(N::kFragment, at, "fragment with {} frames follows one with {}", now,
                   walk.frames);
  }
  if (head.walk.followed.count(at) == 0)
    findings.warning(N::kUnlistedRecord, at, "fragment is not linked to by the index");
  walk.frames = now;
}

// Checks the records in [at, end) of the body, which the index does not list, as far as they are
// available.
void walk_unlisted(const ByteSource& source, const FileHead& head, std::uint64_t at,
                   std::uint64_t end, Walk& walk, Findings& findings) {
  while (at < end) {
    const std::uint64_t left = head.available_bytes - std::min(at, head.available_bytes);
    if (left < std::min(end - at, kRecordHeaderBytes)) return;  // already reported
    std::vector<std::uint8_t> bytes(std::min(kRecordHeaderBytes, end - at));
    if (Status status = source.read(at, bytes); !status.ok()) {
      return findings.failed_read(at, status);
    }
    RecordHeader record;
    if (!parse_record_header(bytes, at, end, record, findings)) return;
    if (record.length > left - kRecordHeaderBytes) return;
    const bool fragment = head.growing() && record.tag == kFragmentTag;
    const bool page = !head.growing() && record.tag == kPageTag;
    const bool segment =
        check_flags(record, record.tag == kSegmentTag || fragment || page, at, findings) &&
        !fragment && !page;
    if (!fits_memory(record, head, at, findings)) {
      at += kRecordHeaderBytes + record.length;
      continue;
    }
    bytes.resize(record.length);
    if (Status status = source.read(at + kRecordHeaderBytes, bytes); !status.ok()) {
      return findings.failed_read(at, status);
    }
    const bool intact = check_payload(record, bytes, at + kRecordHeaderBytes, findings);
    if (intact && fragment) {
      check_fragment(bytes, head, at, walk, findings);
    }
    if (intact && page && head.walk.followed.count(at) == 0 && walk.copies.count(at) == 0)
      findings.warning(N::kUnlistedRecord, at, "node is not linked to by the index");
    if (intact && record.tag == kImportanceTag && record.flags == 0) {
      (void)parse_importance(bytes, head.index.primitives, at, findings);
    }
    if (intact && record.tag == kCopyTag && record.flags == 0) {
      check_head_copy(head, at, bytes, findings);
    }
    if (intact) check_private_record(record, bytes, at, findings);
    // Content added by later versions is not reported (spec 5.5, 6.5).
    if (segment && bytes.size() >= 4 && bytes[3] <= static_cast<int>(Content::kSh)) {
      findings.warning(N::kUnlistedRecord, at, "segment record is not listed in the index");
    }
    at += kRecordHeaderBytes + record.length;
  }
}

// Checks the content after the last complete fragment of a growing file: complete records, and one
// that is being written or was truncated.
void walk_tail(const ByteSource& source, const FileHead& head, std::uint64_t from,
               Findings& findings) {
  const std::uint64_t size = source.size();
  if (from >= size) return;
  findings.warning(N::kIncompleteTail, from, "{} bytes after the last complete fragment",
                   size - from);
  for (std::uint64_t at = from; size - at >= kRecordHeaderBytes;) {
    std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
    if (Status status = source.read(at, bytes); !status.ok()) {
      return findings.failed_read(at, status);
    }
    RecordHeader record;
    const std::uint64_t no_end = std::numeric_limits<std::uint64_t>::max();
    if (!parse_record_header(bytes, at, no_end, record, findings)) return;
    at += kRecordHeaderBytes;
    if (record.length > size - at) return;
    if (!fits_memory(record, head, at, findings)) return;
    bytes.resize(record.length);
    if (Status status = source.read(at, bytes); !status.ok()) {
      return findings.failed_read(at, status);
    }
    check_payload(record, bytes, at, findings);
    at += record.length;
  }
}

// Checks the records of the body between and after those listed in the index.
void walk_body(const ByteSource& source, FileHead& head, const std::set<std::uint64_t>& copies,
               Findings& findings) {
  std::uint64_t at = head.header.head_bytes;
  Walk walk{copies, 0};
  for (const IndexEntry* record : records_of(head.index)) {
    if (record->offset < at) {
      findings.error(N::kSegmentRange, record->offset, "records of two segments overlap");
    } else {
      walk_unlisted(source, head, at, record->offset, walk, findings);
    }
    at = std::max(at, record->offset + record->bytes);
  }
  walk_unlisted(source, head, at, head.header.file_bytes, walk, findings);
  if (head.growing() && !head.closed) walk_tail(source, head, head.header.file_bytes, findings);
}

// Checks that timed data states its times and lies in a segment that contains them (spec 5.7).
void check_timed(ByteReader& in, const FurtherEntry& record, const FileHead& head,
                 Findings& findings) {
  if (content_of(record.entry.layer) < kFirstPrivateContent) return;
  const double begin = in.f64(), end = in.f64();
  const TickRange interval = interval_of(head, record.entry, record.part);
  if (in.ok() && interval.begin <= begin && begin <= end && end <= interval.end) return;
  findings.error(
      N::kTimedData, record.entry.offset,
      "timed data is truncated or outside its segment (ticks {} to {}, segment {} to {})", begin,
      end, interval.begin, interval.end);
}

// Checks that records of unknown content match the index (spec 5.7).
void check_further(const ByteSource& source, const FileHead& head, Findings& findings) {
  for (const FurtherEntry& further : head.index.further) {
    const IndexEntry& entry = further.entry;
    constexpr std::uint64_t kBytes = kRecordHeaderBytes + 8 + 2 * 8;
    if (!head.has(entry)) continue;  // truncated: already reported
    std::vector<std::uint8_t> bytes(std::min(entry.bytes, kBytes));
    if (Status status = source.read(entry.offset, bytes); !status.ok()) {
      findings.failed_read(entry.offset, status);
      continue;
    }
    RecordHeader record;
    if (!parse_record_header(bytes, entry.offset, entry.offset + entry.bytes, record, findings)) {
      continue;
    }
    ByteReader in{std::span<const std::uint8_t>(bytes).subspan(kRecordHeaderBytes)};
    const auto level = static_cast<std::int16_t>(in.u16());
    const std::uint16_t layer = in.u16();
    const std::uint32_t slot = in.u32();
    if (in.ok() && record.tag == kSegmentTag && level == entry.level && layer == entry.layer &&
        slot == entry.slot) {
      check_timed(in, further, head, findings);
      continue;
    }
    findings.error(N::kSegmentMismatch, entry.offset,
                   "record of content {} does not match its index entry", content_of(entry.layer));
  }
}

// Checks the records of the head that reading skips.
void walk_head_records(const FileHead& head, Findings& findings) {
  for (std::uint64_t at = kHeaderBytes; at < head.bytes.size();) {
    const auto rest = std::span(head.bytes).subspan(at);
    RecordHeader record;
    if (!parse_record_header(rest, at, head.bytes.size(), record, findings)) return;
    const std::uint64_t payload_at = at + kRecordHeaderBytes;
    at = payload_at + record.length;
    if ((record.flags & kCritical) != 0) continue;
    const auto payload = rest.subspan(kRecordHeaderBytes, record.length);
    if (record.tag == kWindowTag || record.tag == kPrivateTag || record.tag == kStepTag ||
        record.tag == kErrorTag) {
      continue;  // already checked
    }
    if (record.tag == kCopyTag) {
      findings.warning(N::kForeignCopy, payload_at - kRecordHeaderBytes, "head copy within a head");
    }
    if (!check_payload(record, payload, payload_at, findings)) continue;
    check_private_record(record, payload, payload_at, findings);
  }
}

// Checks the available records of a segment, and its primitives even if its SH are damaged.
void check_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                   Findings& findings) {
  const SegmentEntry& segment = head.index.segments[ordinal];
  if (!head.has(segment.base)) return;  // truncated: already reported
  const bool has_sh = head.has(segment.sh);
  SegmentRecords records;
  Gaussians4D set;
  bool good = read_segment(source, head, ordinal, has_sh, records, findings);
  for (const SegmentRecord* record : {&records.base, &records.sh}) {
    check_private_layouts(record->own, record->payload_at, head, findings);
  }
  good = good && decode_segment(records, head, ordinal, kAllAttributes, set, findings);
  if (!good && has_sh && segment.sh.bytes > 0) {
    Findings reported;
    good = read_segment(source, head, ordinal, false, records = {}, reported) && reported.ok() &&
           decode_segment(records, head, ordinal, kAllAttributes, set = {}, reported);
  }
  if (good) check_values(set, head, ordinal, findings);
}

void check_segments(const ByteSource& source, FileHead& head, Findings& findings) {
  for (std::uint32_t i = 0; i < head.index.segments.size(); ++i) {
    check_segment(source, head, i, findings);
  }
  for (const Layout& layout : head.layouts.layouts) {
    if (layout.problem == 0) continue;
    findings.error(static_cast<N>(layout.problem), layout.problem_at, "{}", layout.why);
  }
  check_further(source, head, findings);
  const std::set<std::uint64_t> copies = check_index(source, head, findings);
  walk_body(source, head, copies, findings);
  walk_head_records(head, findings);
  check_private_numbers(head, findings);
}

}  // namespace

Result<std::vector<Issue>> validate_scene(const ByteSource& source, const ReadLimits& limits) {
  try {
    Findings findings;
    FileHead head;
    // Beyond the limits nothing is decoded.
    const bool reachable = read_head(source, limits, IndexLoading::kComplete, head, findings);
    Status status = findings.status(source.name());
    if (status.code() == StatusCode::kIo) return status;
    if (reachable && status.code() != StatusCode::kUnsupported) {
      check_segments(source, head, findings);
    }
    // Not an issue of the file.
    Status checked = findings.status(source.name());
    if (checked.code() == StatusCode::kNotBuilt) return checked;
    return findings.take();
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", source.name(), e.what()));
  }
}

}  // namespace stgs
