// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <exception>

#include "codec/values.h"
#include "container/segment.h"
#include "container/segment_times.h"

namespace stgs {
namespace {

using N = IssueNumber;

std::vector<SegmentInfo> segments_from(const FileHead& head) {
  std::vector<SegmentInfo> out;
  for (const SegmentEntry& segment : head.index.segments) {
    const IndexEntry &base = segment.base, &sh = segment.sh;
    const Interval interval = shown_of(head, segment);
    out.push_back({base.level, interval.begin, interval.end, base.primitives, base.offset,
                   base.bytes, segment.part, tier_of(base.layer), sh.offset, sh.bytes,
                   head.has(base), head.has(sh)});
  }
  return out;
}

std::vector<ScenePart> parts_from(const FileHead& head) {
  std::vector<ScenePart> out;
  for (const PartEntry& part : head.parts) out.push_back({part.begin, part.end, 0, part.cut});
  for (const SegmentEntry& segment : head.index.segments) {
    out[segment.part].primitives += segment.base.primitives;
  }
  return out;
}

// Returns the time up to which nothing is missing.
double complete_ticks_of(const FileHead& head, const std::vector<SegmentInfo>& segments) {
  double ticks = head.metadata.scene.frames;
  for (const LostFragment& lost : head.lost_fragments) ticks = std::min(ticks, lost.range.begin);
  for (const SegmentInfo& segment : segments) {
    const bool complete = segment.available && segment.sh_available;
    if (segment.is_shown() && !complete) ticks = std::min(ticks, segment.begin_ticks);
  }
  return ticks;
}

class Reader final : public SceneReader {
 public:
  Reader(std::unique_ptr<ByteSource> source, FileHead head, std::vector<Issue> damage,
         const ReadLimits& limits, std::pmr::memory_resource* memory)
      : source_(std::move(source)),
        limits_(limits),
        memory_(memory),
        head_(std::move(head)),
        damage_(std::move(damage)) {
    list_segments();
  }

  const SceneMetadata& metadata() const override { return head_.metadata.scene; }
  Profile profile() const override { return head_.metadata.profile; }
  std::uint16_t version_major() const override { return head_.header.major; }
  std::uint16_t version_minor() const override { return head_.header.minor; }
  int sh_degree() const override { return head_.metadata.sh_degree; }
  std::uint64_t primitives() const override { return head_.index.primitives; }
  std::uint64_t file_bytes() const override { return head_.header.file_bytes; }
  std::uint64_t head_bytes() const override { return head_.index_bytes; }
  SceneForm form() const override {
    if (!head_.growing()) return SceneForm::kFinished;
    return head_.closed ? SceneForm::kRecorded : SceneForm::kGrowing;
  }
  std::uint64_t incomplete_bytes() const override {
    return head_.growing() ? source_->size() - head_.header.file_bytes : 0;
  }

  std::uint32_t unreached_frames() const override { return head_.unreached_frames; }
  const std::vector<Issue>& damage() const override { return damage_; }
  std::uint64_t missing_bytes() const override {
    return head_.header.file_bytes - std::min(head_.available_bytes, head_.header.file_bytes);
  }
  const std::vector<LostFragment>& lost_fragments() const override { return head_.lost_fragments; }
  double complete_ticks() const override { return complete_ticks_; }

  Result<bool> refresh() override {
    if (head_.closed) return false;
    try {
      const std::uint64_t complete = head_.header.file_bytes;
      STGS_ASSIGN(const ByteSource::Change change, source_->refresh(complete));
      if (change == ByteSource::Change::kReplaced) {
        return invalid_file("{}: replaced or truncated below its {} complete bytes; open it again",
                            source_->name(), complete);
      }
      Findings findings;
      FileHead head;
      read_head(*source_, limits_, head, findings);
      if (!findings.ok()) return findings.status(source_->name());
      if (head.header.file_bytes < head_.header.file_bytes) {
        return invalid_file("{}: shrank from {} to {} complete bytes; open it again",
                            source_->name(), head_.header.file_bytes, head.header.file_bytes);
      }
      const bool grown = head.header.file_bytes > head_.header.file_bytes;
      head_ = std::move(head);
      damage_ = findings.take();
      list_segments();
      return grown;
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("{}: {}", source_->name(), e.what()));
    }
  }

  double chunk_ticks() const override { return head_.index.chunk_ticks; }
  bool has_layouts() const override { return !head_.layouts.layouts.empty(); }
  const std::vector<SegmentInfo>& segments() const override { return segments_; }
  const std::vector<ScenePart>& parts() const override { return parts_; }

  std::vector<StreamInfo> streams() const override {
    std::vector<StreamInfo> out;
    for (Attribute attribute : attributes_of(sh_degree())) {
      StreamInfo info{name_of(attribute), 0,
                      primitives() * 4 * static_cast<std::uint64_t>(components_of(attribute))};
      for (const AttributeBytes& row : head_.index.attributes) {
        if (row.attribute == static_cast<std::uint16_t>(attribute)) info.bytes += row.bytes;
      }
      out.push_back(std::move(info));
    }
    return out;
  }

  std::vector<std::uint32_t> segments_between(double t0, double t1) const override {
    return times_.between(t0, t1);
  }

  Result<Gaussians4D> decode(std::uint32_t segment, bool with_sh) const override {
    return with_records(segment, with_sh, decode_segment, Gaussians4D(memory_));
  }
  Result<CodedSegment> read(std::uint32_t segment, bool with_sh) const override {
    return with_records(segment, with_sh, code_segment, CodedSegment());
  }
  std::span<const RansLookup> tables() const override { return head_.layouts.lookups; }

  // IMPO of a lossless scene follows the last segment (spec 5.11).
  Result<std::vector<float>> importance() const override {
    std::uint64_t at = head_.header.head_bytes;
    for (const SegmentEntry& segment : head_.index.segments) {
      for (const IndexEntry* entry : {&segment.base, &segment.sh}) {
        at = std::max(at, entry->offset + entry->bytes);
      }
    }
    Findings findings;
    std::vector<float> values;
    while (at < head_.header.file_bytes && findings.ok()) {
      const std::optional<RecordHeader> record = read_header(at, findings);
      if (!record) break;
      if (record->tag == kImportanceTag && record->flags == 0) {
        read_values(at, *record, values, findings);
        break;
      }
      at += kRecordHeaderBytes + record->length;
    }
    if (!findings.ok()) return findings.status(source_->name());
    return values;
  }

 private:
  // Derives segments, parts and times from the head.
  void list_segments() {
    segments_ = segments_from(head_);
    times_ = {segments_, static_cast<double>(head_.metadata.scene.frames)};
    parts_ = parts_from(head_);
    complete_ticks_ = complete_ticks_of(head_, segments_);
  }

  // Reads the records of a segment and converts them with `make`, into `out`.
  template <typename T, typename Make>
  Result<T> with_records(std::uint32_t segment, bool with_sh, const Make& make, T out) const {
    if (segment >= segments_.size()) {
      return usage_error("{}: invalid segment index {} (the file has {} segments)", source_->name(),
                         segment, segments_.size());
    }
    try {
      Findings findings;
      SegmentRecords records;
      if (read_segment(*source_, head_, segment, with_sh, records, findings) && findings.ok()) {
        make(records, head_, segment, out, findings);
      }
      if (!findings.ok()) return findings.status(source_->name());
      return out;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: segment {}: {}", source_->name(), segment, e.what()));
    }
  }

  // Returns whether bytes before the stated end of the file are available.
  bool is_available(std::uint64_t at, std::uint64_t bytes, Findings& findings) const {
    const std::uint64_t needed = std::min(bytes, head_.header.file_bytes - at);
    if (at <= head_.available_bytes && needed <= head_.available_bytes - at) return true;
    findings.error(N::kFileSize, at, "the file is truncated after its segments");
    return false;
  }

  std::optional<RecordHeader> read_header(std::uint64_t at, Findings& findings) const {
    if (!is_available(at, kRecordHeaderBytes, findings)) return {};
    std::vector<std::uint8_t> bytes(std::min(kRecordHeaderBytes, head_.header.file_bytes - at));
    if (Status status = source_->read(at, bytes); !status.ok()) {
      findings.failed_read(at, status);
      return {};
    }
    RecordHeader record;
    if (!parse_record_header(bytes, at, head_.header.file_bytes, record, findings)) return {};
    return record;
  }

  void read_values(std::uint64_t at, const RecordHeader& record, std::vector<float>& values,
                   Findings& findings) const {
    if (!is_available(at + kRecordHeaderBytes, record.length, findings)) return;
    if (record.length > limits_.max_memory) {
      return findings.unsupported(N::kMemoryLimit, at,
                                  "importances of {} bytes exceed the memory limit of {} bytes",
                                  record.length, limits_.max_memory);
    }
    std::vector<std::uint8_t> bytes(record.length);
    if (Status status = source_->read(at + kRecordHeaderBytes, bytes); !status.ok()) {
      return findings.failed_read(at, status);
    }
    if (!check_payload(record, bytes, at + kRecordHeaderBytes, findings)) return;
    values = parse_importance(bytes, primitives(), at, findings);
  }

  std::unique_ptr<ByteSource> source_;
  ReadLimits limits_;
  std::pmr::memory_resource* memory_;  // of decoded sets
  FileHead head_;
  std::vector<Issue> damage_;
  std::vector<SegmentInfo> segments_;
  SegmentTimes times_;
  double complete_ticks_ = 0;
  std::vector<ScenePart> parts_;
};

}  // namespace

math::PinholeCamera pinhole_of(const StartCamera& camera, float near_plane) {
  const float *r = camera.rotation, *t = camera.translation;
  math::PinholeCamera out;
  out.rotation = {r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]};
  out.translation = {t[0], t[1], t[2]};
  out.fx = camera.fx;
  out.fy = camera.fy;
  out.cx = camera.cx;
  out.cy = camera.cy;
  out.width = static_cast<float>(camera.width);
  out.height = static_cast<float>(camera.height);
  out.near_plane = near_plane;
  return out;
}

const char* profile_name(Profile profile) {
  switch (profile) {
    case Profile::kLossless:
      return "lossless";
    case Profile::kQuantised:
      return "quantised";
    case Profile::kDraco:
      return "draco";
    case Profile::kUnknown:
      break;
  }
  return "unknown";
}

Result<Gaussians4D> SceneReader::decode_intact(std::uint32_t segment, Status& sh_status) const {
  sh_status = {};
  if (segment < segments().size() && !segments()[segment].sh_available) {
    sh_status = invalid_file("segment {}: SH are missing, the file is truncated", segment);
    return decode(segment, false);
  }
  Result<Gaussians4D> complete = decode(segment, true);
  const StatusCode code = complete.status().code();
  const bool is_damage = code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported;
  if (!is_damage || segments()[segment].sh_bytes == 0) return complete;
  Result<Gaussians4D> base = decode(segment, false);
  if (!base.ok()) return base;
  sh_status = complete.status();
  return base;
}

Result<std::unique_ptr<SceneReader>> SceneReader::open(std::unique_ptr<ByteSource> source,
                                                       const ReadLimits& limits,
                                                       std::pmr::memory_resource* memory) {
  try {
    Findings findings;
    FileHead head;
    read_head(*source, limits, head, findings);
    if (!findings.ok()) return findings.status(source->name());
    return std::unique_ptr<SceneReader>(std::make_unique<Reader>(std::move(source), std::move(head),
                                                                 findings.take(), limits, memory));
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("cannot open the file: {}", e.what()));
  }
}

Result<std::unique_ptr<SceneReader>> SceneReader::open(const std::string& path,
                                                       const ReadLimits& limits) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  return open(std::move(source), limits);
}

}  // namespace stgs
