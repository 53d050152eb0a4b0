// SPDX-License-Identifier: Apache-2.0
// Conversion of a recording to a file with its index in the head. All records except those of the
// index are copied unchanged, including unknown and damaged ones.
#include <algorithm>
#include <exception>
#include <set>

#include "core/bytes.h"
#include "scene/damage_count.h"
#include "scene/recording.h"
#include "stgs/format/output_file.h"
#include "stgs/format/scene_recorder.h"

namespace stgs {
namespace {

constexpr std::uint64_t kFramesAt = 8, kBoundsAt = 32;  // in META's payload, spec 4.2
constexpr std::uint64_t kCopyBytes = 1 << 20;           // copied at a time

// A record listed in the index.
struct IndexedRecord {
  IndexEntry entry;
  std::uint32_t part = 0;
  const SegmentEntry* segment = nullptr;  // null: a further record
};
std::vector<IndexedRecord> indexed_records(const FileIndex& index) {
  std::vector<IndexedRecord> out;
  for (const SegmentEntry& segment : index.segments) {
    out.push_back({segment.base, segment.part, &segment});
    if (segment.sh.bytes > 0) out.push_back({segment.sh, segment.part, &segment});
  }
  for (const FurtherEntry& further : index.further) {
    out.push_back({further.entry, further.part, nullptr});
  }
  std::sort(out.begin(), out.end(), [](const IndexedRecord& a, const IndexedRecord& b) {
    return a.entry.offset < b.entry.offset;
  });
  return out;
}

Status copy(const ByteSource& source, const RecordArea& area, OutputFile& file) {
  std::vector<std::uint8_t> bytes;
  for (std::uint64_t at = area.begin; at < area.end; at += bytes.size()) {
    bytes.resize(std::min(kCopyBytes, area.end - at));
    STGS_TRY(source.read(at, bytes));
    STGS_TRY(file.write(bytes));
  }
  return {};
}

// Writes a finished file with its damaged head replaced by the copy.
Status repair_head(const ByteSource& source, const FileHead& head, const std::string& output) {
  OutputFile file;
  STGS_TRY(file.open(output));
  STGS_TRY(file.write(head.repaired));
  STGS_TRY(copy(source, {head.header.head_bytes, head.header.file_bytes}, file));
  return file.commit();
}

// Copies the records of a recording to a file.
class Finalizer {
 public:
  Finalizer(const ByteSource& source, FileHead& head, DamageReport& report)
      : source_(source), head_(head), report_(report), records_(indexed_records(head.index)) {}

  Status write(const std::string& output) {
    STGS_TRY(plan());
    std::vector<std::uint8_t> records;
    STGS_TRY(read_head_records(records));
    const std::vector<std::uint8_t> index =
        write_record(kIndexTag, write_index(head_.index, head_.parts));
    records.insert(records.end(), index.begin(), index.end());
    FileHeader header;
    header.minor = head_.header.minor;  // as its records are
    header.flags = head_.header.flags & ~kGrowing;
    const CopiedHead head = write_copied_head(header, records, body_bytes_);
    OutputFile file;
    STGS_TRY(file.open(output));
    STGS_TRY(file.write(head.head));
    STGS_TRY(write_body(file));
    STGS_TRY(file.write(head.copy));
    if (head_.index.primitives > 0 && unreadable_primitives_ == head_.index.primitives) {
      return report_.reason;
    }
    merge_ranges(report_);
    return file.commit();
  }

 private:
  // Finds the records between those of the index, and sets the skips of the parts.
  Status plan() {
    for (PartEntry& part : head_.parts) part.skip = 0;
    std::uint64_t at = head_.header.head_bytes;
    for (const IndexedRecord& record : records_) {
      STGS_ASSIGN(const std::uint64_t skipped, plan_others(at, record.entry.offset));
      head_.parts[record.part].skip += skipped;
      at = record.entry.offset + record.entry.bytes;
      body_bytes_ += record.entry.bytes;
    }
    return plan_others(at, head_.header.file_bytes).status();
  }

  // Adds the non-critical records of [at, end). Critical ones are FRAG, and segments lost with a
  // damaged fragment. COPY is written again. Records after a damaged header cannot be located.
  Result<std::uint64_t> plan_others(std::uint64_t at, std::uint64_t end) {
    std::uint64_t found = 0;
    while (end - at >= kRecordHeaderBytes) {
      std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
      STGS_TRY(source_.read(at, bytes));
      Findings damaged;
      RecordHeader record;
      if (!parse_record_header(bytes, at, end, record, damaged)) {
        report_omitted(record, at, end, damaged);
        break;
      }
      const std::uint64_t size = kRecordHeaderBytes + record.length;
      if ((record.flags & kCritical) == 0 && record.tag != kCopyTag) {
        others_.push_back({at, at + size});
        found += size;
      }
      at += size;
    }
    body_bytes_ += found;
    return found;
  }

  // Reports a damaged record header, unless it is that of a final FRAG record.
  void report_omitted(const RecordHeader& record, std::uint64_t at, std::uint64_t end,
                      Findings& damaged) {
    if (record.tag == kFragmentTag && record.length == end - at - kRecordHeaderBytes) return;
    for (Issue& issue : damaged.take()) {
      issue.message += fmt::format("; omitting all content up to byte {}", end);
      report_.damage.push_back(std::move(issue));
    }
  }

  // Reads all records of the head, with the last fragment's frames and bounds in META.
  Status read_head_records(std::vector<std::uint8_t>& out) const {
    STGS_ASSIGN(out, read_head_bytes(source_, head_));
    out.erase(out.begin(), out.begin() + kHeaderBytes);
    std::uint64_t size = 0;
    for (std::uint64_t at = 0; at < out.size(); at += size) {
      const std::span<std::uint8_t> rest = std::span(out).subspan(at);
      ByteReader in(rest);
      const std::uint32_t tag = in.u32(), flags = in.u32();
      size = kRecordHeaderBytes + in.u64();
      if (tag != kMetadataTag || flags != kCritical) continue;
      const std::vector<std::uint8_t> record =
          write_record(tag, metadata_payload(rest.first(size).subspan(kRecordHeaderBytes)));
      std::copy(record.begin(), record.end(), rest.begin());
    }
    return {};
  }

  std::vector<std::uint8_t> metadata_payload(std::span<const std::uint8_t> payload) const {
    const SceneMetadata& scene = head_.metadata.scene;
    ByteWriter frames, bounds;
    frames.u32(scene.frames);
    for (float v : scene.bounds_min) bounds.f32(v);
    for (float v : scene.bounds_max) bounds.f32(v);
    std::vector<std::uint8_t> out(payload.begin(), payload.end());
    std::copy(frames.view().begin(), frames.view().end(), out.begin() + kFramesAt);
    std::copy(bounds.view().begin(), bounds.view().end(), out.begin() + kBoundsAt);
    return out;
  }

  Status write_body(OutputFile& file) {
    std::vector<std::uint8_t> bytes;
    auto other = others_.begin();
    for (const IndexedRecord& record : records_) {
      for (; other != others_.end() && other->begin < record.entry.offset; ++other) {
        STGS_TRY(copy(source_, *other, file));
      }
      Findings findings;
      if (!copy_record(source_, record.entry, bytes, findings)) {
        Status status = findings.status(source_.name());
        if (status.code() != StatusCode::kInvalidFile) return status;
        count(record, status);
      }
      STGS_TRY(file.write(bytes));
    }
    for (; other != others_.end(); ++other) STGS_TRY(copy(source_, *other, file));
    return {};
  }

  // Adds a damaged record to the report.
  void count(const IndexedRecord& record, const Status& status) {
    if (record.segment == nullptr) {
      ++report_.further;
      const TickRange interval = interval_of(head_, record.entry, record.part);
      const double begin = head_.parts[record.part].begin;
      return count_damage(report_, {begin + interval.begin, begin + interval.end},
                          record.entry.bytes, status);
    }
    const SegmentEntry& segment = *record.segment;
    const TickRange shown = shown_of(head_, segment);
    std::uint64_t bytes = record.entry.bytes;
    if (record.entry.offset == segment.base.offset) {
      unreadable_bases_.insert(record.segment);
      ++report_.segments;
      unreadable_primitives_ += segment.base.primitives;
      report_.primitives += segment.base.primitives;
      bytes += segment.sh.bytes;  // useless without the base record
    } else if (unreadable_bases_.count(record.segment) == 0) {
      ++report_.segments_without_sh;
    } else {
      return;
    }
    count_damage(report_, {shown.begin, shown.end}, bytes, status);
  }

  const ByteSource& source_;
  FileHead& head_;
  DamageReport& report_;
  std::set<const SegmentEntry*> unreadable_bases_;
  std::uint64_t unreadable_primitives_ = 0;
  std::vector<IndexedRecord> records_;
  std::vector<RecordArea> others_;  // records between and after them
  std::uint64_t body_bytes_ = 0;
};

}  // namespace

Status finalize_scene(std::unique_ptr<ByteSource> recording, const std::string& output,
                      DamageReport& report) {
  try {
    STGS_ASSIGN(FileHead head, read_recording(*recording, report));
    if (!head.growing()) return repair_head(*recording, head, output);
    return Finalizer(*recording, head, report).write(output);
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", recording->name(), e.what()));
  }
}

}  // namespace stgs
