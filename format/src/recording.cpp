// SPDX-License-Identifier: Apache-2.0
#include "recording.h"

#include <algorithm>

#include "lost_records.h"

namespace stgs {
namespace {

// The bytes of each attribute in `all` beyond those in `before`.
std::vector<AttributeBytes> totals_beyond(const std::vector<AttributeBytes>& all,
                                          const std::vector<AttributeBytes>& before) {
  std::vector<AttributeBytes> out = all;
  for (AttributeBytes& row : out) {
    for (const AttributeBytes& other : before) {
      if (other.attribute == row.attribute) row.bytes -= other.bytes;
    }
  }
  return out;
}

// Whether all bytes of the last fragment's own records are there, as a power cut can leave them
// not.
bool last_stretch_is_whole(const ByteSource& source, const FileHead& head) {
  const auto last = static_cast<std::uint32_t>(head.parts.size() - 1);
  Findings found;
  std::vector<std::uint8_t> bytes;
  for (const SegmentEntry& segment : head.index.segments) {
    if (segment.part != last) continue;
    for (const IndexEntry* entry : {&segment.base, &segment.harmonics}) {
      if (entry->bytes > 0) copy_record(source, *entry, bytes, found);
    }
  }
  return found.ok();
}

// Counts the segments of the last part as lost where they all are; else false.
Result<bool> lose_last_stretch(const ByteSource& source, const FileHead& head,
                               DamageReport& losses) {
  const auto last = static_cast<std::uint32_t>(head.parts.size() - 1);
  DamageReport lost;
  std::vector<std::uint8_t> bytes;
  for (const SegmentEntry& segment : head.index.segments) {
    if (segment.part != last) continue;
    Findings found;
    if (copy_record(source, segment.base, bytes, found)) return false;
    const Status status = found.status(source.name());
    if (status.code() != StatusCode::kInvalidFile) return status;
    const Interval shown = shown_of(head, segment);
    ++lost.segments;
    lost.primitives += segment.base.primitives;
    count_lost(lost, {shown.begin, shown.end}, segment.base.bytes + segment.harmonics.bytes,
               status);
  }
  if (lost.segments == 0) return false;
  lost.damage = std::move(losses.damage);
  lost.lost_fragments = std::move(losses.lost_fragments);
  lost.incomplete_bytes = losses.incomplete_bytes;
  lost.unreached_frames = losses.unreached_frames;
  lost.total_segments = losses.total_segments;
  losses = std::move(lost);
  return true;
}

// The first bytes of a source.
class Beginning final : public ByteSource {
 public:
  Beginning(const ByteSource& whole, std::uint64_t size) : whole_(whole), size_(size) {}
  std::uint64_t size() const override { return size_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return whole_.read(offset, out);
  }
  const std::string& name() const override { return whole_.name(); }

 private:
  const ByteSource& whole_;
  std::uint64_t size_ = 0;
};

// Whether every stretch is one part with its fragment behind it, as a Recorder lays them out.
bool is_ours(const ByteSource& source, const FileHead& head) {
  const auto none = [&head](const FragmentEntry& f) { return f.first_part >= head.parts.size(); };
  if (std::any_of(head.fragments.begin(), head.fragments.end(), none)) return false;
  for (const Stretch& stretch : stretches_of(head)) {
    std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
    if (!source.read(stretch.fragment, bytes).ok()) return false;
    Findings found;
    RecordHeader record;
    if (!parse_record_header(bytes, stretch.fragment, source.size(), record, found)) return false;
    if (record.tag != kFragmentTag) return false;
  }
  return true;
}

}  // namespace

std::vector<Stretch> stretches_of(const FileHead& head) {
  std::vector<Stretch> out(head.parts.size());
  for (std::size_t p = 0; p < out.size(); ++p) out[p].part = head.parts[p];
  for (SegmentEntry segment : head.index.segments) {
    Stretch& stretch = out[segment.part];
    stretch.primitives += segment.base.primitives;
    stretch.segments.push_back(std::move(segment));
  }
  std::uint64_t at = head.header.head_bytes;
  for (std::size_t p = 0; p < out.size(); ++p) {
    at += out[p].part.skip;
    for (const IndexEntry* record : records_of(out[p].segments)) at += record->bytes;
    out[p].fragment = at;
    out[p].fragment_bytes = p + 1 < out.size() ? out[p + 1].part.skip : 0;
  }
  const std::vector<FragmentEntry>& fragments = head.fragments;
  out.back().fragment_bytes = fragments.back().bytes;
  for (std::size_t f = 0; f < fragments.size(); ++f) {
    const auto& all = f + 1 < fragments.size() ? fragments[f + 1].before : head.index.attributes;
    out[fragments[f].first_part].attributes = totals_beyond(all, fragments[f].before);
  }
  for (Stretch& stretch : out) {
    if (stretch.attributes.empty())
      stretch.attributes = totals_beyond(head.index.attributes, head.index.attributes);
  }
  return out;
}

bool copy_record(const ByteSource& source, const IndexEntry& entry,
                 std::vector<std::uint8_t>& bytes, Findings& findings) {
  bytes.resize(entry.bytes);
  if (Status status = source.read(entry.offset, bytes); !status.ok()) {
    findings.failed_read(entry.offset, status);
    return false;
  }
  RecordHeader header;
  return parse_record_header(bytes, entry.offset, entry.offset + entry.bytes, header, findings) &&
         check_payload(header, std::span(bytes).subspan(kRecordHeaderBytes),
                       entry.offset + kRecordHeaderBytes, findings);
}

Result<FileHead> read_resumable(const ByteSource& source) {
  for (std::uint64_t size = source.size();;) {
    const Beginning beginning(source, size);
    Findings findings;
    FileHead head;
    read_head(beginning, {}, head, findings);
    if (!findings.ok()) return findings.status(source.name());
    if (!head.growing() || head.closed) {
      return usage_error("{}: is finished; nothing can be appended to it", source.name());
    }
    const std::vector<Issue> issues = findings.take();
    if (std::any_of(issues.begin(), issues.end(), [](const Issue& i) { return i.error; })) {
      return invalid_file(
          "{}: its head or a fragment of its index is damaged; 'stgs finalize' keeps the rest",
          source.name());
    }
    if (head.unreached_frames > 0) {
      return invalid_file(
          "{}: a record that leads to a fragment of its index is damaged; 'stgs finalize' keeps "
          "the "
          "rest",
          source.name());
    }
    if (head.fragments.empty()) return head;
    if (!is_ours(source, head)) {
      return unsupported("{}: is laid out otherwise than this recorder does; 'stgs finalize' it",
                         source.name());
    }
    if (last_stretch_is_whole(source, head)) return head;
    size = head.fragments.back().offset;  // a power cut: without this fragment
  }
}

Result<FileHead> read_recording(const ByteSource& source, DamageReport& losses) {
  Findings findings;
  FileHead head;
  read_head(source, {}, head, findings);
  if (!findings.ok()) return findings.status(source.name());
  if (!head.growing() && head.repaired.empty()) {
    return usage_error("{}: has its index in the head already", source.name());
  }
  losses = {};
  losses.damage = findings.take();
  losses.lost_fragments = head.lost;
  losses.incomplete_bytes = source.size() - head.header.file_bytes;
  losses.unreached_frames = head.unreached_frames;
  losses.total_segments = head.index.segments.size();
  if (head.closed || head.parts.size() < 2) return head;
  STGS_ASSIGN(const bool lost, lose_last_stretch(source, head, losses));
  if (!lost) return head;
  const Beginning beginning(source, head.fragments.back().offset);
  FileHead before;
  read_head(beginning, {}, before, findings);
  if (!findings.ok()) return findings.status(source.name());
  return before;
}

}  // namespace stgs
