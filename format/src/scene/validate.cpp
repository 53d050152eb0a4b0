// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <exception>
#include <mutex>
#include <optional>
#include <set>

#include "codec/values.h"
#include "container/node.h"
#include "container/segment.h"
#include "core/read_ahead.h"
#include "quantise/segmenter.h"
#include "scene/validate_ends.h"
#include "scene/validate_index.h"

namespace stgs {
namespace {

using N = IssueNumber;
constexpr double kIntervalTolerance = 0.01;  // ticks, spec 5.8

// A source that is not read any more once a read has failed: with a server that fails, each of the
// further reads could take as long as the first. Borrows the source. Thread-safe.
class UntilFailure final : public ByteSource {
 public:
  explicit UntilFailure(const ByteSource& source) : source_(source) {}

  std::uint64_t size() const override { return source_.size(); }
  const std::string& name() const override { return source_.name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    const std::lock_guard lock(mutex_);
    // A range beyond the end is a defect of the file.
    if (failure_.ok()) STGS_TRY(check_range(name(), size(), offset, out.size()));
    if (failure_.ok()) failure_ = source_.read(offset, out);
    return failure_;
  }
  bool has_failed() const {
    const std::lock_guard lock(mutex_);
    return !failure_.ok();
  }

 private:
  const ByteSource& source_;
  mutable std::mutex mutex_;  // guards failure_
  mutable Status failure_;
};

// Checks primitives of a segment against what the file states about it.
class PlacementChecks {
 public:
  PlacementChecks(const FileHead& head, std::uint32_t segment)
      : head_(head),
        segment_(segment),
        entry_(head.index.segments[segment]),
        interval_(interval_of(head, entry_.base, entry_.part)) {}

  void add(const Gaussians4D& set, std::size_t begin) {
    const PartEntry& part = head_.parts[entry_.part];
    const SceneMetadata& scene = head_.metadata.scene;
    outside_segment_.add(set.size(), begin, [&](std::size_t i) {
      const Lifetime lifetime = lifetime_of(set, i, part.end - part.begin, false, set.time_origin);
      return !lifetime.never && (lifetime.begin < interval_.begin - kIntervalTolerance ||
                                 lifetime.end > interval_.end + kIntervalTolerance);
    });
    outside_bounds_.add(set.size(), begin, [&](std::size_t i) {
      bool outside = false;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float x = set.position[3 * i + axis];
        outside |= x < scene.bounds_min[axis] || x > scene.bounds_max[axis];
      }
      return outside;
    });
  }

  void report(Findings& findings) const {
    const std::uint32_t n = entry_.base.primitives;
    const std::uint64_t at = entry_.base.offset;
    outside_segment_.report(n, N::kOutsideSegment, true, segment_, at,
                            "visible outside the segment's interval", findings);
    outside_bounds_.report(n, N::kOutsideBounds, false, segment_, at,
                           "position outside the stated bounds", findings);
  }

 private:
  const FileHead& head_;
  const std::uint32_t segment_;
  const SegmentEntry& entry_;
  const TickRange interval_;
  ProblemCount outside_segment_, outside_bounds_;
};

// Returns whether the payload of a record, all of which is read, is within the caller's limit.
bool fits_memory(const RecordHeader& record, const FileHead& head, std::uint64_t at,
                 Findings& findings) {
  if (record.length <= head.limits.max_memory) return true;
  findings.unsupported(N::kMemoryLimit, at,
                       "record '{}' of {} bytes exceeds the memory limit of {} bytes",
                       tag_text(record.tag), record.length, head.limits.max_memory);
  return false;
}

// What the records of the body have stated so far.
struct BodyState {
  std::set<std::uint64_t> copies;  // offsets of the copies of nodes
  std::uint32_t frames = 0;        // of the last FRAG record
  bool has_importance = false;     // IMPO
  bool after_segments = false;     // of the index
};

// Checks a FRAG record of a growing file (spec 9.2, 9.3).
void check_fragment(std::span<const std::uint8_t> payload, const FileHead& head, std::uint64_t at,
                    BodyState& body, Findings& findings) {
  ByteReader in(payload);
  const std::uint64_t stated = in.u64();
  const std::uint32_t now = in.u32(), flags = in.u32();
  if (head.walk.followed.count(at) == 0)
    findings.error(N::kFragment, at, "fragment is not valid, or no link leads to it");
  if (!in.ok() || stated != at) return;
  const bool is_last = head.last_fragment && at == head.last_fragment->offset;
  if (const std::uint32_t unknown = flags & kCriticalFragmentFlags & ~kFragmentClosed;
      unknown != 0 && !is_last) {
    findings.unsupported(N::kUnknownCritical, at, "fragment has unknown critical flags {:#x}",
                         unknown);
  }
  if ((flags & kFragmentClosed) != 0 && !is_last)
    findings.error(N::kFragment, at, "fragment marked as the last one is followed by others");
  if (now < body.frames) {
    findings.error(N::kFragment, at, "fragment with {} frames follows one with {}", now,
                   body.frames);
  }
  body.frames = now;
}

// Checks a record that is not critical, at a place outside of segments.
void check_other(const RecordHeader& record, std::span<const std::uint8_t> payload,
                 const FileHead& head, std::uint64_t at, BodyState& body, Findings& findings) {
  if (head.growing())
    findings.error(N::kFragment, at, "record '{}' within a fragment", tag_text(record.tag));
  if (record.flags == 0 && record.tag == kImportanceTag && body.after_segments) {
    if (body.has_importance) findings.error(N::kDuplicateRecord, at, "duplicate 'IMPO' record");
    (void)parse_importance(payload, head.index.primitives, at, findings);
    body.has_importance = true;
  }
  if (record.flags == 0 && record.tag == kCopyTag) check_head_copy(head, at, payload, findings);
  if (record.flags == 0 && (record.tag == kWindowTag || record.tag == kPrivateTag ||
                            record.tag == kStepTag || record.tag == kErrorTag)) {
    findings.warning(N::kWrongArea, at, "record '{}' outside of the head", tag_text(record.tag));
  }
  check_private_record(record, payload, at, findings);
}

// Checks the records in [at, end) of the body, which the index does not list, as far as they are
// available.
void walk_unlisted(const ByteSource& source, const FileHead& head, std::uint64_t at,
                   std::uint64_t end, BodyState& body, Findings& findings) {
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
    if (intact && fragment) check_fragment(bytes, head, at, body, findings);
    if (page && head.walk.followed.count(at) == 0 && body.copies.count(at) == 0)
      findings.warning(N::kUnlistedRecord, at, "PAGE record to which no link leads");
    if (intact && (record.flags & kCritical) == 0)
      check_other(record, bytes, head, at, body, findings);
    // Content added by later versions is not reported (spec 5.5, 6.5).
    if (segment && bytes.size() >= 4 &&
        (bytes[3] <= static_cast<int>(Content::kSh) ||
         bytes[3] == static_cast<int>(Content::kEnds))) {
      findings.warning(N::kUnlistedRecord, at, "segment record is not listed in the index");
    }
    at += kRecordHeaderBytes + record.length;
  }
}

// Checks the records of the body between and after those listed in the index.
void walk_body(const ByteSource& source, FileHead& head, std::set<std::uint64_t> copies,
               Findings& findings) {
  std::uint64_t at = head.header.head_bytes;
  BodyState body;
  body.copies = std::move(copies);
  for (const RecordRange* record : records_of(head.index)) {
    if (record->offset < at) {
      findings.error(N::kPlace, record->offset, "records of two segments overlap");
    } else {
      walk_unlisted(source, head, at, record->offset, body, findings);
    }
    at = std::max(at, record->offset + record->bytes);
  }
  body.after_segments = true;
  walk_unlisted(source, head, at, head.header.file_bytes, body, findings);
  const std::uint64_t end = head.header.file_bytes;
  if (head.growing() && !head.closed && end < source.size()) {  // being written, or cut off
    findings.warning(N::kIncompleteTail, end, "{} bytes after the last complete fragment",
                     source.size() - end);
  }
}

// Checks further records other than ends, as far as they are available (spec 5.7).
void check_further(const ByteSource& source, const FileHead& head, Findings& findings) {
  for (const FurtherEntry& further : head.index.further) {
    FurtherRecord record;
    if (head.has(further.entry) && !is_ends(further.entry))
      (void)read_further(source, head, further, record, findings);
  }
}

// Checks the records of the head that reading skips.
void walk_head_records(const FileHead& head, Findings& findings) {
  for (std::uint64_t at = kHeaderBytes; at < head.bytes->size();) {
    const auto rest = std::span(*head.bytes).subspan(at);
    RecordHeader record;
    if (!parse_record_header(rest, at, head.bytes->size(), record, findings)) return;
    const std::uint64_t payload_at = at + kRecordHeaderBytes;
    at = payload_at + record.length;
    if ((record.flags & kCritical) != 0) continue;
    const auto payload = rest.subspan(kRecordHeaderBytes, record.length);
    if (record.tag == kWindowTag || record.tag == kPrivateTag || record.tag == kStepTag ||
        record.tag == kErrorTag) {
      continue;  // already checked
    }
    if (record.flags == 0 && (record.tag == kCopyTag || record.tag == kImportanceTag)) {
      findings.warning(N::kWrongArea, payload_at - kRecordHeaderBytes, "record '{}' in the head",
                       tag_text(record.tag));
    }
    if (checksum(payload) != record.checksum) continue;  // already reported
    check_private_record(record, payload, payload_at, findings);
  }
}

// Returns the values that are decoded at most: ReadLimits::max_values.
std::uint64_t decoding_limit(const FileHead& head) {
  constexpr std::uint64_t kAnyFile = std::uint64_t{1} << 21, kPerByte = 16;
  const std::uint64_t stated = head.limits.max_values;
  return stated > 0 ? stated : kAnyFile + kPerByte * head.available_bytes;
}

// Checks the available records of a segment, and its primitives even if its SH are damaged.
void check_segment(const ByteSource& source, const FileHead& head, std::uint32_t ordinal,
                   DecodingWork& work, Findings& findings) {
  const SegmentEntry& segment = head.index.segments[ordinal];
  if (!head.has(segment.base)) return;  // truncated: already reported
  const bool has_sh = head.has(segment.sh);
  SegmentRecords records;
  bool good = read_segment(source, head, ordinal, has_sh, records, findings);
  for (const SegmentRecord* record : {&records.base, &records.sh}) {
    check_private_layouts(record->own, record->payload_at, head, findings);
  }
  std::optional<PlacementChecks> placement;
  const auto decode = [&](Findings& found) {
    PlacementChecks& checks = placement.emplace(head, ordinal);
    return decode_ranges(
        records, head, ordinal,
        [&checks](const Gaussians4D& set, std::size_t begin) { checks.add(set, begin); }, work,
        found);
  };
  good = good && decode(findings);
  if (!good && !work.is_refused && has_sh && segment.sh.bytes > 0) {
    Findings reported;
    good = read_segment(source, head, ordinal, false, records = {}, reported) && reported.ok() &&
           decode(reported);
    if (work.is_refused) findings.append(std::move(reported));
  }
  if (good) placement->report(findings);
}

// Checks a layout of the head, which no record may use.
void check_layout(const Layout& layout, Findings& findings) {
  if (layout.problem != 0)
    findings.error(static_cast<N>(layout.problem), layout.problem_at, "{}", layout.why);
  for (const StreamRow& row : layout.streams) {
    if (row.known || row.optional()) continue;
    findings.unsupported(
        N::kStreamUnsupported, kHeaderBytes,
        "layouts: unknown attribute {} with mapping {}, prediction {} and coder {}", row.attribute,
        row.mapping, row.prediction, row.coder);
  }
}

// Checks that a near-lossless file states its error bounds (spec 11.1).
void check_error_bounds(const FileHead& head, Findings& findings) {
  if (head.metadata.profile == Profile::kNearLossless && head.error_bounds.empty()) {
    findings.error(N::kErrorBounds, kHeaderBytes,
                   "a near-lossless file without a valid record of error bounds");
  }
}

// Checks all that follows the head, until a read fails.
void check_segments(const UntilFailure& source, FileHead& head, Findings& findings) {
  DecodingWork work{decoding_limit(head)};
  for (std::uint32_t i = 0; i < head.index.segments.size() && !work.is_refused; ++i) {
    check_segment(source, head, i, work, findings);
    if (source.has_failed()) return;
  }
  for (const Layout& layout : head.layouts->layouts) check_layout(layout, findings);
  check_further(source, head, findings);
  check_ends(head, findings);
  walk_body(source, head, check_index(source, head, findings), findings);
  walk_head_records(head, findings);
  check_private_numbers(head, findings);
  check_error_bounds(head, findings);
}

}  // namespace

Result<std::vector<Issue>> validate_scene(const ByteSource& file, const ReadLimits& limits) {
  const ReadAhead ahead(file);  // most records are read in order
  const UntilFailure source(ahead);
  try {
    Findings findings;
    FileHead head;
    head.walk.keeps_nodes = true;
    // Beyond the limits nothing is decoded.
    const bool reachable = read_head(source, limits, IndexLoading::kComplete, head, findings);
    Status status = findings.status(source.name());
    if (status.code() == StatusCode::kIo) return status;
    if (reachable && status.code() != StatusCode::kUnsupported) {
      check_segments(source, head, findings);
    }
    // Not issues of the file.
    Status checked = findings.status(source.name());
    if (checked.code() == StatusCode::kNotBuilt || checked.code() == StatusCode::kIo)
      return checked;
    return findings.take();
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", source.name(), e.what()));
  }
}

}  // namespace stgs
