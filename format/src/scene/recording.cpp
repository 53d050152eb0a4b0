// SPDX-License-Identifier: Apache-2.0
#include "scene/recording.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <set>

#include "scene/damage_count.h"

namespace stgs {
namespace {

// Returns the segments of the last fragment of a recording.
std::vector<SegmentEntry> last_segments(const FileHead& head) {
  const std::set<std::uint64_t>& fragments = head.walk.followed;
  const std::uint64_t before = fragments.size() > 1 ? *std::next(fragments.rbegin()) : 0;
  std::vector<SegmentEntry> out;
  for (const SegmentEntry& segment : head.index.segments) {
    if (segment.base.offset > before) out.push_back(segment);
  }
  return out;
}

// Returns the records that the index lists, by offset.
std::vector<RecordRange> listed_records(const FileHead& head) {
  std::vector<RecordRange> out;
  for (const SegmentEntry& segment : head.index.segments) {
    out.push_back(segment.base);
    if (segment.sh.bytes > 0) out.push_back(segment.sh);
  }
  for (const FurtherEntry& further : head.index.further) out.push_back(further.entry);
  std::sort(out.begin(), out.end(),
            [](const RecordRange& a, const RecordRange& b) { return a.offset < b.offset; });
  return out;
}

// Returns whether a record is intact; an error if it cannot be read.
Result<bool> is_intact(const ByteSource& source, const RecordRange& record) {
  std::vector<std::uint8_t> bytes;
  Findings found;
  if (copy_record(source, record, bytes, found)) return true;
  if (found.code() == StatusCode::kInvalidFile) return false;
  return found.status(source.name());
}

// Fragments with damaged records at the end of a recording: where the first one begins, or the end
// of the last fragment, and their number.
struct DamagedEnd {
  std::uint64_t offset = 0;
  int fragments = 0;
};

// Looks for fragments that a power failure has damaged, from the last one to an intact one, and
// through at most `most` of them.
Result<DamagedEnd> find_damaged_end(const ByteSource& source, const FileHead& head, int most) {
  std::vector<RecordRange> records = listed_records(head);
  DamagedEnd out{head.last_fragment->offset + head.last_fragment->bytes, 0};
  const std::set<std::uint64_t>& fragments = head.walk.followed;  // each after its records
  for (auto fragment = fragments.rbegin(); fragment != fragments.rend() && out.fragments < most;
       ++fragment) {
    const std::uint64_t before = std::next(fragment) != fragments.rend() ? *std::next(fragment) : 0;
    bool intact = true;
    for (; !records.empty() && records.back().offset > before; records.pop_back()) {
      if (!intact) continue;
      STGS_ASSIGN(intact, is_intact(source, records.back()));
    }
    if (intact) break;
    out.offset = *fragment;
    ++out.fragments;
  }
  return out;
}

// Adds the segments of the last fragment to the report if all of them are damaged; otherwise
// returns false.
Result<bool> drop_last_fragment(const ByteSource& source, const FileHead& head,
                                DamageReport& report) {
  DamageReport dropped;
  std::vector<std::uint8_t> bytes;
  for (const SegmentEntry& segment : last_segments(head)) {
    Findings found;
    if (copy_record(source, segment.base, bytes, found)) return false;
    Status status = found.status(source.name());
    if (status.code() != StatusCode::kInvalidFile) return status;
    const TickRange needed = needed_of(head, segment);
    ++dropped.segments;
    dropped.primitives += segment.base.primitives;
    count_damage(dropped, {needed.begin, needed.end}, segment.base.bytes + segment.sh.bytes,
                 status);
  }
  if (dropped.segments == 0) return false;
  dropped.damage = std::move(report.damage);
  dropped.lost_fragments = std::move(report.lost_fragments);
  dropped.incomplete_bytes = report.incomplete_bytes;
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

// Returns the greatest power of 16 that divides a number.
std::uint64_t power_in(std::uint64_t number) {
  return std::uint64_t{1} << (std::countr_zero(number) & ~3);
}

// Returns the numbers of the fragments that a recorder's links lead to after `count` fragments.
std::vector<std::uint64_t> linked_after(std::uint64_t count) {
  std::vector<std::uint64_t> out;
  for (std::uint64_t left = count; left > 0; left -= power_in(left)) out.push_back(left);
  std::reverse(out.begin(), out.end());
  return out;
}

}  // namespace

FragmentLinks::FragmentLinks(const FileHead& head) {
  if (!head.last_fragment) return;
  const LastFragment& last = *head.last_fragment;
  count_ = head.walk.followed.size();
  std::vector<NodeLink> links = last.earlier;
  links.push_back({last.needed, last.offset, 0, last.bytes - kRecordHeaderBytes});
  const std::vector<std::uint64_t> numbers = linked_after(count_);
  const bool ours = numbers.size() == links.size();
  for (std::size_t i = 0; i < links.size(); ++i) {
    // The links of another program are passed on as they are.
    const std::uint64_t number = ours ? numbers[i] : 0;
    const int depth = ours ? 1 + std::countr_zero(number) / 4 : kMaxLinkDepth;
    links_.push_back({links[i], number, depth});
  }
}

bool FragmentLinks::is_taken(const Link& link) const {
  const std::uint64_t next = count_ + 1;
  return link.number > next - power_in(next) && link.depth < kMaxLinkDepth;
}

void FragmentLinks::take(FragmentRecord& next) const {
  for (const Link& link : links_) {
    (is_taken(link) ? next.node.links : next.earlier).push_back(link.link);
  }
}

void FragmentLinks::add(const FragmentRecord& fragment) {
  std::vector<Link> left;
  int depth = 0;
  for (const Link& link : links_) {
    if (is_taken(link)) {
      depth = std::max(depth, link.depth);
    } else {
      left.push_back(link);
    }
  }
  links_ = std::move(left);
  links_.push_back({{needed_of(fragment.node), fragment.offset, 0,
                     fragment.end - fragment.offset - kRecordHeaderBytes},
                    ++count_,
                    depth + 1});
}

bool copy_record(const ByteSource& source, const RecordRange& record,
                 std::vector<std::uint8_t>& bytes, Findings& findings) {
  bytes.resize(record.bytes);
  if (Status status = source.read(record.offset, bytes); !status.ok()) {
    findings.failed_read(record.offset, status);
    return false;
  }
  RecordHeader header;
  return parse_record_header(bytes, record.offset, record.offset + record.bytes, header,
                             findings) &&
         check_payload(header, std::span(bytes).subspan(kRecordHeaderBytes),
                       record.offset + kRecordHeaderBytes, findings);
}

Result<FileHead> read_resumable(const ByteSource& source) {
  // A power failure damages the fragments that were not written through: the last one, or those of
  // half a minute without `sync`. Without them, segments that they replaced are found, and checked.
  constexpr int kMaxFragments = 64, kMaxTimes = 3;
  std::uint64_t size = source.size();
  for (int times = 0, fragments = 0; times < kMaxTimes; ++times) {
    const PrefixSource prefix(source, size);
    Findings findings;
    FileHead head;
    read_head(prefix, {}, IndexLoading::kComplete, head, findings);
    if (!findings.ok()) return findings.status(source.name());
    if (!head.growing() || head.closed) {
      return usage_error("{}: recording is finished; nothing can be appended", source.name());
    }
    const std::vector<Issue> issues = findings.take();
    // Damaged ends are found below, as other damaged records are.
    if (std::any_of(issues.begin(), issues.end(), [](const Issue& i) {
          return i.error && i.number != static_cast<int>(IssueNumber::kEnds);
        })) {
      return invalid_file("{}: head or index is damaged; save the rest with 'stgs finalize'",
                          source.name());
    }
    if (!head.last_fragment) return head;
    STGS_ASSIGN(const DamagedEnd end, find_damaged_end(source, head, kMaxFragments + 1));
    if (end.fragments == 0) return head;
    fragments += end.fragments;
    if (fragments > kMaxFragments) break;
    size = end.offset;
  }
  return invalid_file(
      "{}: its last fragments are damaged, more than a power failure explains; "
      "save the rest with 'stgs finalize'",
      source.name());
}

Result<FileHead> read_recording(const ByteSource& source, const ReadLimits& limits,
                                DamageReport& report) {
  Findings findings;
  FileHead head;
  read_head(source, limits, IndexLoading::kComplete, head, findings);
  if (!findings.ok()) return findings.status(source.name());
  if (!head.growing() && !head.repaired) {
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
  report.total_segments = head.index.segments.size();
  if (head.closed || head.walk.followed.size() < 2) return head;
  STGS_ASSIGN(const bool dropped, drop_last_fragment(source, head, report));
  if (!dropped) return head;
  const PrefixSource prefix(source, head.last_fragment->offset);
  FileHead before;
  read_head(prefix, limits, IndexLoading::kComplete, before, findings);
  if (!findings.ok()) return findings.status(source.name());
  return before;
}

}  // namespace stgs
