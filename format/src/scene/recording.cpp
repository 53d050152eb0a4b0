// SPDX-License-Identifier: Apache-2.0
#include "scene/recording.h"

#include <algorithm>

#include "scene/damage_count.h"

namespace stgs {
namespace {

// Returns the bytes of each attribute in `all` minus those in `before`.
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

// Returns whether the records of the last fragment are intact. A power failure can leave them
// damaged.
bool is_last_fragment_intact(const ByteSource& source, const FileHead& head) {
  const auto last = static_cast<std::uint32_t>(head.parts.size() - 1);
  Findings found;
  std::vector<std::uint8_t> bytes;
  for (const SegmentEntry& segment : head.index.segments) {
    if (segment.part != last) continue;
    for (const IndexEntry* entry : {&segment.base, &segment.sh}) {
      if (entry->bytes > 0) copy_record(source, *entry, bytes, found);
    }
  }
  return found.ok();
}

// Adds the segments of the last part to the report if all of them are damaged; otherwise returns
// false.
Result<bool> drop_last_fragment(const ByteSource& source, const FileHead& head,
                                DamageReport& report) {
  const auto last = static_cast<std::uint32_t>(head.parts.size() - 1);
  DamageReport dropped;
  std::vector<std::uint8_t> bytes;
  for (const SegmentEntry& segment : head.index.segments) {
    if (segment.part != last) continue;
    Findings found;
    if (copy_record(source, segment.base, bytes, found)) return false;
    Status status = found.status(source.name());
    if (status.code() != StatusCode::kInvalidFile) return status;
    const TickRange shown = shown_of(head, segment);
    ++dropped.segments;
    dropped.primitives += segment.base.primitives;
    count_damage(dropped, {shown.begin, shown.end}, segment.base.bytes + segment.sh.bytes, status);
  }
  if (dropped.segments == 0) return false;
  dropped.damage = std::move(report.damage);
  dropped.lost_fragments = std::move(report.lost_fragments);
  dropped.incomplete_bytes = report.incomplete_bytes;
  dropped.unreached_frames = report.unreached_frames;
  dropped.total_segments = report.total_segments;
  report = std::move(dropped);
  return true;
}

// The first `size` bytes of a source.
class PrefixSource final : public ByteSource {
 public:
  PrefixSource(const ByteSource& source, std::uint64_t size) : source_(source), size_(size) {}
  std::uint64_t size() const override { return size_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return source_.read(offset, out);
  }
  const std::string& name() const override { return source_.name(); }

 private:
  const ByteSource& source_;
  std::uint64_t size_ = 0;
};

// Returns whether every fragment is one part followed by its FRAG record, as SceneRecorder writes
// it.
bool has_our_layout(const ByteSource& source, const FileHead& head) {
  const auto none = [&head](const FragmentEntry& f) { return f.first_part >= head.parts.size(); };
  if (std::any_of(head.fragments.begin(), head.fragments.end(), none)) return false;
  for (const Fragment& fragment : fragments_of(head)) {
    std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
    if (!source.read(fragment.record_offset, bytes).ok()) return false;
    Findings found;
    RecordHeader record;
    if (!parse_record_header(bytes, fragment.record_offset, source.size(), record, found))
      return false;
    if (record.tag != kFragmentTag) return false;
  }
  return true;
}

}  // namespace

std::vector<Fragment> fragments_of(const FileHead& head) {
  std::vector<Fragment> out(head.parts.size());
  for (std::size_t p = 0; p < out.size(); ++p) out[p].part = head.parts[p];
  for (const SegmentEntry& segment : head.index.segments) {
    Fragment& fragment = out[segment.part];
    fragment.primitives += segment.base.primitives;
    fragment.segments.push_back(segment);
  }
  std::uint64_t at = head.header.head_bytes;
  for (std::size_t p = 0; p < out.size(); ++p) {
    at += out[p].part.skip;
    for (const IndexEntry* record : records_of(out[p].segments)) at += record->bytes;
    out[p].record_offset = at;
    out[p].record_bytes = p + 1 < out.size() ? out[p + 1].part.skip : 0;
  }
  const std::vector<FragmentEntry>& fragments = head.fragments;
  out.back().record_bytes = fragments.back().bytes;
  for (std::size_t f = 0; f < fragments.size(); ++f) {
    const auto& all = f + 1 < fragments.size() ? fragments[f + 1].before : head.index.attributes;
    out[fragments[f].first_part].attributes = totals_beyond(all, fragments[f].before);
  }
  for (Fragment& fragment : out) {
    if (fragment.attributes.empty())
      fragment.attributes = totals_beyond(head.index.attributes, head.index.attributes);
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
    const PrefixSource prefix(source, size);
    Findings findings;
    FileHead head;
    read_head(prefix, {}, head, findings);
    if (!findings.ok()) return findings.status(source.name());
    if (!head.growing() || head.closed) {
      return usage_error("{}: recording is finished; nothing can be appended", source.name());
    }
    const std::vector<Issue> issues = findings.take();
    if (std::any_of(issues.begin(), issues.end(), [](const Issue& i) { return i.error; })) {
      return invalid_file(
          "{}: head or index fragment is damaged; save the rest with 'stgs finalize'",
          source.name());
    }
    if (head.unreached_frames > 0) {
      return invalid_file(
          "{}: a record before an index fragment is damaged; save the rest with 'stgs finalize'",
          source.name());
    }
    if (head.fragments.empty()) return head;
    if (!has_our_layout(source, head)) {
      return unsupported("{}: recorded by another program; complete it with 'stgs finalize'",
                         source.name());
    }
    if (is_last_fragment_intact(source, head)) return head;
    size = head.fragments.back().offset;  // power failure: continue without this fragment
  }
}

Result<FileHead> read_recording(const ByteSource& source, DamageReport& report) {
  Findings findings;
  FileHead head;
  read_head(source, {}, head, findings);
  if (!findings.ok()) return findings.status(source.name());
  if (!head.growing() && head.repaired.empty()) {
    if (source.size() < head.header.file_bytes) {
      return invalid_file("{}: the file is truncated (expected {} bytes, got {}); copy it again",
                          source.name(), head.header.file_bytes, source.size());
    }
    return usage_error("{}: already finished; nothing to do ('stgs validate' checks its data)",
                       source.name());
  }
  report = {};
  report.damage = findings.take();
  report.lost_fragments = head.lost_fragments;
  report.incomplete_bytes = source.size() - head.header.file_bytes;
  report.unreached_frames = head.unreached_frames;
  report.total_segments = head.index.segments.size();
  if (head.closed || head.parts.size() < 2) return head;
  STGS_ASSIGN(const bool dropped, drop_last_fragment(source, head, report));
  if (!dropped) return head;
  const PrefixSource prefix(source, head.fragments.back().offset);
  FileHead before;
  read_head(prefix, {}, before, findings);
  if (!findings.ok()) return findings.status(source.name());
  return before;
}

}  // namespace stgs
