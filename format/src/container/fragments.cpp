// SPDX-License-Identifier: Apache-2.0
// Growing files: reading and writing an index in fragments (spec 5.12).
#include <algorithm>
#include <limits>
#include <optional>

#include "container/container.h"
#include "core/bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

// Before the index: frames, flags, bounds, offset, head, previous, before. After it: the length.
constexpr std::uint64_t kFixedBytes = 4 + 4 + 6 * 4 + 4 * 8, kLengthBytes = 8;
// Bytes read at a time when searching backwards; the window doubles.
constexpr std::uint64_t kFirstSearchWindow = 64 << 10, kMaxSearchWindow = 4 << 20;

struct FragRecord {
  std::uint64_t offset = 0;  // of its record
  std::uint64_t end = 0;
  FragmentHeader header;
  std::vector<std::uint8_t> payload;
  bool after_damage = false;  // the record named as `previous` is damaged
};
using FoundFragment = std::optional<FragRecord>;

bool is_frag(const RecordHeader& header) {
  return header.tag == kFragmentTag && header.flags == kCritical &&
         header.length >= kFixedBytes + kLengthBytes;
}

// Finds intact FRAG records in the body of a file (spec 5.12).
class FragmentFinder {
 public:
  FragmentFinder(const ByteSource& source, const FileHead& head)
      : source_(source),
        head_(head),
        body_at_(head.header.head_bytes),
        head_checksum_(head.head_checksum),
        limit_(head.limits.max_memory),
        work_(2 * source.size() + kMaxSearchWindow) {}

  // Finds the last complete one: at the end of the file, or else the intact one that begins last.
  Result<FoundFragment> last() {
    STGS_ASSIGN(FoundFragment found, at_end());
    if (found) return found;
    return last_before(source_.size());
  }

  static std::span<const std::uint8_t> index_of(const FragRecord& fragment) {
    const std::span<const std::uint8_t> payload(fragment.payload);
    return payload.subspan(kFixedBytes, payload.size() - kFixedBytes - kLengthBytes);
  }
  // Returns the range that contains the records it lists.
  RecordArea area_of(const FragRecord& fragment) const {
    const std::uint64_t previous = fragment.header.previous;
    return {previous != 0 ? previous : body_at_, fragment.offset};
  }

  // Returns the greatest frame count among undamaged ones that last() could not reach.
  std::uint32_t unreached_frames() const { return unreached_frames_; }

  // Reads the one at `offset` if it is undamaged and ends at or before `end`.
  Result<FoundFragment> at(std::uint64_t offset, std::uint64_t end) {
    STGS_ASSIGN(const auto record, record_at(offset, end));
    if (!record || !is_frag(*record)) return FoundFragment();
    if (record->length > limit_) {
      return unsupported("index fragment of {} bytes exceeds the memory limit of {} bytes",
                         record->length, limit_);
    }
    if (record->length > work_) {
      return invalid_file("too many records resemble index fragments but are not valid");
    }
    work_ -= record->length;
    FragRecord fragment;
    fragment.offset = offset;
    fragment.end = offset + kRecordHeaderBytes + record->length;
    fragment.payload.resize(record->length);
    STGS_TRY(source_.read(offset + kRecordHeaderBytes, fragment.payload));
    if (checksum(fragment.payload) != record->checksum) return FoundFragment();
    read_header(fragment);
    const bool own = fragment.header.offset == offset && fragment.header.head == head_checksum_;
    return own ? FoundFragment(std::move(fragment)) : FoundFragment();
  }

  // Finds the intact one that begins last and ends at or before `end`. Searches backwards in
  // windows of increasing size.
  Result<FoundFragment> last_before(std::uint64_t end) {
    std::vector<std::uint8_t> bytes;
    std::uint64_t window = kFirstSearchWindow;
    for (std::uint64_t high = end; high > body_at_;) {
      const std::uint64_t low = high - std::min(high - body_at_, window);
      // Includes the rest of a header that begins before `high`.
      bytes.resize(std::min(end, high + kRecordHeaderBytes - 1) - low);
      STGS_TRY(source_.read(low, bytes));
      for (std::uint64_t at = high; at-- > low;) {
        if (!looks_like_one(std::span(bytes).subspan(at - low))) continue;
        STGS_ASSIGN(FoundFragment found, intact_at(at, end));
        if (found) return found;
      }
      high = low;
      window = std::min(2 * window, kMaxSearchWindow);
    }
    return FoundFragment();
  }

 private:
  // Returns the header of an intact record of the body.
  Result<std::optional<RecordHeader>> record_at(std::uint64_t offset, std::uint64_t end) const {
    if (offset < body_at_) return std::optional<RecordHeader>();
    return complete_record_at(source_, offset, end);
  }

  static bool looks_like_one(std::span<const std::uint8_t> bytes) {
    RecordHeader header;
    Findings ignored;
    return bytes.size() >= kRecordHeaderBytes && ByteReader(bytes).u32() == kFragmentTag &&
           parse_record_header(bytes, 0, std::numeric_limits<std::uint64_t>::max(), header,
                               ignored) &&
           is_frag(header);
  }

  static void read_header(FragRecord& fragment) {
    ByteReader in(fragment.payload);
    FragmentHeader& header = fragment.header;
    header.frames = in.u32();
    header.flags = in.u32();
    for (float& v : header.bounds_min) v = in.f32();
    for (float& v : header.bounds_max) v = in.f32();
    header.offset = in.u64();
    header.head = in.u64();
    header.previous = in.u64();
    header.before = in.u64();
  }

  // A complete file ends with its last FRAG record, whose last bytes give its length.
  Result<FoundFragment> at_end() {
    const std::uint64_t size = source_.size(), min_bytes = kRecordHeaderBytes + kLengthBytes;
    if (size < min_bytes || size - min_bytes < body_at_) return FoundFragment();
    std::vector<std::uint8_t> bytes(kLengthBytes);
    STGS_TRY(source_.read(size - kLengthBytes, bytes));
    const std::uint64_t length = ByteReader(bytes).u64();
    if (length > size - body_at_ - kRecordHeaderBytes) return FoundFragment();
    return intact_at(size - kRecordHeaderBytes - length, size);
  }

  Result<FoundFragment> intact_at(std::uint64_t offset, std::uint64_t end) {
    STGS_ASSIGN(FoundFragment found, at(offset, end));
    if (!found) return found;
    STGS_ASSIGN(const bool reached, is_reached(*found));
    if (!reached) unreached_frames_ = std::max(unreached_frames_, found->header.frames);
    return reached ? std::move(found) : FoundFragment();
  }

  // Returns whether following the records from the preceding fragment leads to a segment record or
  // to this record. Otherwise it may be part of another record's payload.
  Result<bool> is_reached(const FragRecord& fragment) {
    std::uint64_t at = body_at_;
    if (fragment.header.before != 0) {
      STGS_ASSIGN(const auto before, record_at(fragment.header.before, fragment.offset));
      if (!before || !is_frag(*before)) return false;
      at = fragment.header.before + kRecordHeaderBytes + before->length;
    }
    const std::uint64_t first = at;
    while (at != fragment.offset) {
      STGS_ASSIGN(const auto record, record_at(at, fragment.offset));
      if (!record) return lists_a_record(fragment, first);
      if (work_ < kRecordHeaderBytes) return false;
      if (record->tag == kSegmentTag && record->flags == kCritical) return true;
      work_ -= kRecordHeaderBytes;
      at += kRecordHeaderBytes + record->length;
    }
    return true;
  }

  // Used if a record header in between is damaged: returns whether a record listed by the fragment
  // is at its stated offset, at or after `first`. Version 1.0 did not accept this.
  Result<bool> lists_a_record(const FragRecord& fragment, std::uint64_t first) {
    if (head_.header.minor < kCopyMinor) return false;
    FileHead listed;
    listed.limits = head_.limits;
    listed.header = head_.header;
    listed.metadata = head_.metadata;
    Findings ignored;  // reported later, if the fragment is used
    if (!parse_index(index_of(fragment), 0, area_of(fragment), listed, ignored)) return false;
    for (const SegmentEntry& segment : listed.index.segments) {
      if (segment.base.offset < first) continue;
      if (work_ < kRecordHeaderBytes) return false;
      work_ -= kRecordHeaderBytes;
      STGS_ASSIGN(const auto record, record_at(segment.base.offset, fragment.offset));
      if (record && record->tag == kSegmentTag && record->flags == kCritical) return true;
    }
    return false;
  }

  const ByteSource& source_;
  const FileHead& head_;
  std::uint64_t body_at_ = 0, head_checksum_ = 0, limit_ = 0;
  std::uint32_t unreached_frames_ = 0;
  std::uint64_t work_ = 0;  // remaining budget for reading candidates, bytes
};

// Collects the FRAG records that list all parts up to `last`, earliest first. Content listed only
// by a damaged one is lost.
bool chain_of(FragmentFinder& fragments, FragRecord last, const FileHead& head,
              std::vector<FragRecord>& chain, Findings& findings) {
  std::uint64_t bytes = last.payload.size();
  chain.push_back(std::move(last));
  while (chain.back().header.previous != 0) {
    const std::uint64_t previous = chain.back().header.previous;
    if (previous < head.header.head_bytes || previous >= chain.back().offset) {
      findings.error(N::kFragment, chain.back().offset,
                     "index fragment refers to an invalid previous offset {}", previous);
      return false;
    }
    Result<FoundFragment> found = fragments.at(previous, chain.back().offset);
    if (found.ok() && !*found) {
      findings.damage(N::kFragment, previous,
                      "index fragment is damaged; content listed only by it is lost");
      chain.back().after_damage = true;
      found = fragments.last_before(previous);
    }
    if (!found.ok()) {
      findings.failed_read(previous, found.status());
      return false;
    }
    if (!*found) break;
    bytes += (*found)->payload.size();
    if (bytes > head.limits.max_memory) {
      findings.unsupported(N::kMemoryLimit, previous, "index exceeds the memory limit of {} bytes",
                           head.limits.max_memory);
      return false;
    }
    chain.push_back(std::move(**found));
  }
  std::reverse(chain.begin(), chain.end());
  return true;
}

// Returns the range between a FRAG record and its predecessor in the index, which may be null.
// Parts from `first_part` and segments from `first_segment` on are those that it lists.
LostFragment lost_fragment_between(const FragRecord* before, const FragRecord& fragment,
                                   const FileHead& head, std::size_t first_part,
                                   std::size_t first_segment) {
  LostFragment lost;
  lost.range = {before != nullptr ? before->header.frames : 0.0,
                static_cast<double>(fragment.header.frames)};
  for (std::size_t p = first_part; p < head.parts.size(); ++p) {
    const PartEntry& part = head.parts[p];
    lost.range.end = std::min(lost.range.end, part.cut ? part.cut->begin : part.begin);
  }
  lost.range.end = std::max(lost.range.begin, lost.range.end);
  std::uint64_t end = fragment.offset;
  for (std::size_t s = first_segment; s < head.index.segments.size(); ++s) {
    end = std::min(end, head.index.segments[s].base.offset);
  }
  lost.offset = before != nullptr ? before->end : head.header.head_bytes;
  lost.bytes = end - lost.offset;
  return lost;
}

// Checks the last FRAG record and takes frames and bounds from it.
bool check_header(const FragRecord& fragment, FileHead& head, Findings& findings) {
  const FragmentHeader& header = fragment.header;
  if (!check_fragment_flags(header.flags, true, fragment.offset, findings)) return false;
  SceneMetadata& scene = head.metadata.scene;
  scene.frames = header.frames;
  std::copy_n(header.bounds_min, 3, scene.bounds_min);
  std::copy_n(header.bounds_max, 3, scene.bounds_max);
  if (header.frames == 0) {
    findings.error(N::kTimeBase, fragment.offset, "index fragment states 0 frames");
    return false;
  }
  check_metadata_values(head.metadata, fragment.offset, findings);
  return true;
}

}  // namespace

std::vector<std::uint8_t> write_fragment(const FragmentHeader& header,
                                         std::span<const std::uint8_t> index) {  // spec 5.12
  ByteWriter out;
  out.u32(header.frames);
  out.u32(header.flags);
  for (float v : header.bounds_min) out.f32(v);
  for (float v : header.bounds_max) out.f32(v);
  out.u64(header.offset);
  out.u64(header.head);
  out.u64(header.previous);
  out.u64(header.before);
  out.bytes(index);
  out.u64(out.size() + kLengthBytes);
  return write_record(kFragmentTag, out.view());
}

bool check_fragment_flags(std::uint32_t flags, bool last, std::uint64_t offset,
                          Findings& findings) {
  if ((flags & kCriticalFragmentFlags & ~kFragmentClosed) != 0) {
    findings.unsupported(N::kUnknownCritical, offset,
                         "index fragment has unknown critical flags {:#x}", flags);
    return false;
  }
  if (last || (flags & kFragmentClosed) == 0) return true;
  findings.error(N::kFragment, offset, "index fragment marked as last is followed by others");
  return false;
}

bool read_fragments(const ByteSource& source, FileHead& head, Findings& findings) {
  const std::uint64_t body_at = head.header.head_bytes;
  FragmentFinder fragments(source, head);
  Result<std::optional<FragRecord>> last = fragments.last();
  if (!last.ok()) {
    findings.failed_read(body_at, last.status());
    return false;
  }
  const std::uint32_t complete = *last ? (*last)->header.frames : 0;
  if (fragments.unreached_frames() > complete) head.unreached_frames = fragments.unreached_frames();
  if (!*last) {  // nothing is complete yet
    const Result<std::uint64_t> end = end_of_head_copy(source, head.header);
    if (!end.ok()) {
      findings.failed_read(body_at, end.status());
      return false;
    }
    head.index_bytes = body_at;
    head.header.file_bytes = *end;
    head.parts.push_back({0.0, static_cast<double>(head.metadata.scene.frames), 0});
    head.index.chunk_ticks = 1.0;
    return true;
  }
  head.header.file_bytes = (*last)->end;
  head.closed = ((*last)->header.flags & kFragmentClosed) != 0;
  if (!check_header(**last, head, findings)) return false;
  if (head.closed && source.size() > head.header.file_bytes) {
    findings.damage(N::kFileSize, head.header.file_bytes,
                    "extra bytes after the end of the file (expected {} bytes, got {}); copy or "
                    "download it again",
                    head.header.file_bytes, source.size());
  }
  std::vector<FragRecord> chain;
  if (!chain_of(fragments, std::move(**last), head, chain, findings)) return false;
  head.index_bytes = body_at;
  for (std::size_t i = 0; i < chain.size(); ++i) {
    const FragRecord& fragment = chain[i];
    const std::size_t parts = head.parts.size(), segments = head.index.segments.size();
    head.index_bytes += fragment.end - fragment.offset;
    head.fragments.push_back({fragment.offset, fragment.end - fragment.offset, head.parts.size(),
                              head.index.attributes});
    const bool is_last = i + 1 == chain.size();
    if (!check_fragment_flags(fragment.header.flags, is_last, fragment.offset, findings)) {
      return false;
    }
    if (!parse_index(FragmentFinder::index_of(fragment),
                     fragment.offset + kRecordHeaderBytes + kFixedBytes,
                     fragments.area_of(fragment), head, findings)) {
      return false;
    }
    if (!fragment.after_damage) continue;
    head.lost_fragments.push_back(
        lost_fragment_between(i > 0 ? &chain[i - 1] : nullptr, fragment, head, parts, segments));
  }
  check_index(head, chain.back().offset, head.limits, findings);
  return true;
}

}  // namespace stgs
