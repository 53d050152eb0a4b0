// SPDX-License-Identifier: Apache-2.0
// A recording as a file with its index in the head: all of its records but those of the index are
// copied as they are, those that this version does not know, or that are damaged, too.
#include <algorithm>
#include <exception>
#include <set>

#include "bytes.h"
#include "lost_records.h"
#include "recording.h"
#include "stgs/format/output_file.h"
#include "stgs/format/scene_recorder.h"

namespace stgs {
namespace {

constexpr std::uint64_t kFramesAt = 8, kBoundsAt = 32;  // in META's payload, spec 4.2
constexpr std::uint64_t kPiece = 1 << 20;               // of what is copied at a time

// The records of the index, in the order of the file.
struct IndexedRecord {
  IndexEntry entry;
  std::uint32_t part = 0;
  const SegmentEntry* segment = nullptr;  // null: a further record
};
std::vector<IndexedRecord> indexed_records(const FileIndex& index) {
  std::vector<IndexedRecord> out;
  for (const SegmentEntry& segment : index.segments) {
    out.push_back({segment.base, segment.part, &segment});
    if (segment.harmonics.bytes > 0) out.push_back({segment.harmonics, segment.part, &segment});
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
    bytes.resize(std::min(kPiece, area.end - at));
    STGS_TRY(source.read(at, bytes));
    STGS_TRY(file.write(bytes));
  }
  return {};
}

// A finished file with the copy of its damaged head in its place.
Status mend(const ByteSource& source, const FileHead& head, const std::string& output) {
  OutputFile file;
  STGS_TRY(file.open(output));
  STGS_TRY(file.write(head.repaired));
  STGS_TRY(copy(source, {head.header.head_bytes, head.header.file_bytes}, file));
  return file.commit();
}

// Copies the records of a recording to a file.
class Finalizer {
 public:
  Finalizer(const ByteSource& source, FileHead& head, DamageReport& losses)
      : source_(source), head_(head), losses_(losses), records_(indexed_records(head.index)) {}

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
    if (head_.index.primitives > 0 && lost_primitives_ == head_.index.primitives) {
      return losses_.reason;
    }
    join_moments(losses_);
    return file.commit();
  }

 private:
  // What stands between the records of the index, and with that the skips of the parts.
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

  // The records of [at, end) that are not critical: FRAG is, and so are segments that a damaged
  // fragment has lost. The copy of the head is another one now. Behind a header that is damaged
  // there is nothing to be found.
  Result<std::uint64_t> plan_others(std::uint64_t at, std::uint64_t end) {
    std::uint64_t found = 0;
    while (end - at >= kRecordHeaderBytes) {
      std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
      STGS_TRY(source_.read(at, bytes));
      Findings damaged;
      RecordHeader record;
      if (!parse_record_header(bytes, at, end, record, damaged)) {
        tell_left_out(record, at, end, damaged);
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

  // A damaged header, unless it is a fragment's that nothing follows.
  void tell_left_out(const RecordHeader& record, std::uint64_t at, std::uint64_t end,
                     Findings& damaged) {
    if (record.tag == kFragmentTag && record.length == end - at - kRecordHeaderBytes) return;
    for (Issue& issue : damaged.take()) {
      issue.message += fmt::format("; it and what follows up to byte {} is left out", end);
      losses_.damage.push_back(std::move(issue));
    }
  }

  // All records of the head, META with the last fragment's frames and bounds.
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
        const Status status = findings.status(source_.name());
        if (status.code() != StatusCode::kInvalidFile) return status;
        count(record, status);
      }
      STGS_TRY(file.write(bytes));
    }
    for (; other != others_.end(); ++other) STGS_TRY(copy(source_, *other, file));
    return {};
  }

  // A damaged record: readers show what the others hold.
  void count(const IndexedRecord& record, const Status& status) {
    if (record.segment == nullptr) {
      ++losses_.further;
      const Interval interval = interval_of(head_, record.entry, record.part);
      const double begin = head_.parts[record.part].begin;
      return count_lost(losses_, {begin + interval.begin, begin + interval.end}, record.entry.bytes,
                        status);
    }
    const SegmentEntry& segment = *record.segment;
    const Interval shown = shown_of(head_, segment);
    std::uint64_t bytes = record.entry.bytes;
    if (record.entry.offset == segment.base.offset) {
      lost_bases_.insert(record.segment);
      ++losses_.segments;
      lost_primitives_ += segment.base.primitives;
      losses_.primitives += segment.base.primitives;
      bytes += segment.harmonics.bytes;  // which are nothing without it
    } else if (lost_bases_.count(record.segment) == 0) {
      ++losses_.harmonics;
    } else {
      return;
    }
    count_lost(losses_, {shown.begin, shown.end}, bytes, status);
  }

  const ByteSource& source_;
  FileHead& head_;
  DamageReport& losses_;
  std::set<const SegmentEntry*> lost_bases_;
  std::uint64_t lost_primitives_ = 0;
  std::vector<IndexedRecord> records_;
  std::vector<RecordArea> others_;  // between and behind them
  std::uint64_t body_bytes_ = 0;
};

}  // namespace

Status finalize_scene(std::unique_ptr<ByteSource> recording, const std::string& output,
                      DamageReport& losses) {
  try {
    STGS_ASSIGN(FileHead head, read_recording(*recording, losses));
    if (!head.growing()) return mend(*recording, head, output);
    return Finalizer(*recording, head, losses).write(output);
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", recording->name(), e.what()));
  }
}

}  // namespace stgs
