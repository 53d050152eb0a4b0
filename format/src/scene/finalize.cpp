// SPDX-License-Identifier: Apache-2.0
// Conversion of a recording to a finished file. The records that the index lists and those that are
// not critical are copied unchanged, including unknown and damaged ones.
#include <algorithm>
#include <exception>
#include <map>
#include <utility>

#include "container/body_plan.h"
#include "core/bytes.h"
#include "scene/damage_count.h"
#include "scene/recording.h"
#include "stgs/format/output_file.h"
#include "stgs/format/scene_recorder.h"

namespace stgs {
namespace {

constexpr std::uint64_t kFramesAt = 8, kBoundsAt = 32;  // in META's payload, spec 4.2
constexpr std::uint64_t kCopyBytes = 1 << 20;           // copied at a time

// A range of a file.
struct Range {
  std::uint64_t begin = 0, end = 0;
};

Status copy(const ByteSource& source, const Range& area, OutputFile& file) {
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
  STGS_TRY(file.write(*head.bytes));
  STGS_TRY(copy(source, {head.header.head_bytes, head.header.file_bytes}, file));
  return file.commit();
}

// Copies the records of a recording to a file.
class Finalizer {
 public:
  Finalizer(const ByteSource& source, FileHead& head, DamageReport& report)
      : source_(source), head_(head), report_(report) {}

  Status write(const std::string& output) {
    STGS_TRY(find_others());
    head_.index.primitives = head_.listed_primitives;  // without those that are lost
    std::vector<std::uint8_t> records = head_records();
    std::map<const RecordRange*, std::uint64_t> offsets;  // in the recording
    for (const RecordRange* record : records_of(head_.index)) offsets[record] = record->offset;
    const BodyPlan plan(head_.index, head_.parts, head_.metadata.scene.frames,
                        kHeaderBytes + records.size(), other_bytes_);
    const std::vector<std::uint8_t> index = plan.index_record();
    records.insert(records.end(), index.begin(), index.end());
    FileHeader header;
    header.minor = head_.header.minor;  // as its records are
    header.flags = head_.header.flags & ~kGrowing & ~(has_ends() ? 0 : kHasEnds);
    const std::vector<std::uint8_t> head = write_finished_head(header, records, plan.end());
    OutputFile file;
    STGS_TRY(file.open(output));
    STGS_TRY(file.write(head));
    STGS_TRY(write_body(plan, offsets, file));
    STGS_TRY(file.write(write_head_copy(head)));
    STGS_TRY(count_damaged());
    return file.commit();
  }

 private:
  // Recordings in which primitives may end need not have ends.
  bool has_ends() const {
    const std::vector<FurtherEntry>& further = head_.index.further;
    return std::any_of(further.begin(), further.end(),
                       [](const FurtherEntry& one) { return is_ends(one.entry); });
  }

  // Finds the records that are not critical. Critical ones are FRAG, and segments lost with a
  // damaged fragment. COPY is written again. Records after a damaged header cannot be located.
  Status find_others() {
    std::uint64_t at = head_.header.head_bytes;
    for (const RecordRange* record : records_of(head_.index)) {
      STGS_TRY(find_others(at, record->offset));
      at = std::max(at, record->offset + record->bytes);
    }
    return find_others(at, head_.header.file_bytes);
  }

  Status find_others(std::uint64_t at, std::uint64_t end) {
    while (at < end && end - at >= kRecordHeaderBytes) {
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
        other_bytes_ += size;
      }
      at += size;
    }
    return {};
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

  // Returns all records of the head, with the last fragment's frames and bounds in META.
  std::vector<std::uint8_t> head_records() const {
    std::vector<std::uint8_t> out(head_.bytes->begin() + kHeaderBytes, head_.bytes->end());
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
    return out;
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

  Status write_body(const BodyPlan& plan,
                    const std::map<const RecordRange*, std::uint64_t>& offsets, OutputFile& file) {
    std::vector<std::uint8_t> bytes;
    bool others_written = false;
    const auto write_others = [&]() -> Status {
      if (std::exchange(others_written, true)) return {};
      for (const Range& other : others_) STGS_TRY(copy(source_, other, file));
      return {};
    };
    for (const BodyPlan::Piece& piece : plan.pieces()) {
      if (piece.offset >= plan.others_at()) STGS_TRY(write_others());
      if (piece.record == nullptr) {
        STGS_TRY(file.write(piece.page));
        continue;
      }
      RecordRange stored = *piece.record;
      stored.offset = offsets.at(piece.record);
      Findings findings;
      if (!copy_record(source_, stored, bytes, findings)) {
        Status status = findings.status(source_.name());
        if (status.code() != StatusCode::kInvalidFile) return status;
        damaged_.emplace(piece.record, std::move(status));
      }
      STGS_TRY(file.write(bytes));
    }
    return write_others();
  }

  // Adds the damaged records to the report, in the order of the index.
  Status count_damaged() {
    const auto why = [this](const RecordRange& entry) {
      const auto found = damaged_.find(&entry);
      return found == damaged_.end() ? Status() : found->second;
    };
    for (const SegmentEntry& segment : head_.index.segments) {
      const TickRange needed = needed_of(head_, segment);
      if (const Status base = why(segment.base); !base.ok()) {
        ++report_.segments;
        report_.primitives += segment.base.primitives;
        unreadable_primitives_ += segment.base.primitives;
        // SH are useless without the base record.
        count_damage(report_, needed, segment.base.bytes + segment.sh.bytes, base);
      } else if (const Status sh = why(segment.sh); !sh.ok()) {
        ++report_.segments_without_sh;
        count_damage(report_, needed, segment.sh.bytes, sh);
      }
    }
    for (const FurtherEntry& further : head_.index.further) {
      const Status status = why(further.entry);
      if (status.ok()) continue;
      ++report_.further;
      const TickRange interval = interval_of(head_, further.entry, further.part);
      const double begin = head_.parts[further.part].begin;
      count_damage(report_, {begin + interval.begin, begin + interval.end}, further.entry.bytes,
                   status);
    }
    if (head_.listed_primitives > 0 && unreadable_primitives_ == head_.listed_primitives)
      return report_.reason;
    merge_ranges(report_);
    return {};
  }

  const ByteSource& source_;
  FileHead& head_;
  DamageReport& report_;
  std::uint64_t unreadable_primitives_ = 0;
  std::map<const RecordRange*, Status> damaged_;
  std::vector<Range> others_;  // records that are not critical
  std::uint64_t other_bytes_ = 0;
};

}  // namespace

Status finalize_scene(std::unique_ptr<ByteSource> recording, const std::string& output,
                      DamageReport& report, const ReadLimits& limits) {
  try {
    STGS_ASSIGN(FileHead head, read_recording(*recording, limits, report));
    if (!head.growing()) return repair_head(*recording, head, output);
    return Finalizer(*recording, head, report).write(output);
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", recording->name(), e.what()));
  }
}

}  // namespace stgs
