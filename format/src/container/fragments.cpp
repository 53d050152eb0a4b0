// SPDX-License-Identifier: Apache-2.0
// FRAG records: the index of a growing file (spec 9).
#include <algorithm>
#include <limits>
#include <utility>

#include "container/node.h"
#include "core/read_bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

// The fields before the number of primitives, and the length after the additions.
constexpr std::uint64_t kFixedBytes = 8 + 4 + 4 + 6 * 4, kLengthBytes = 8;
// Bytes read at a time when searching backwards; the window doubles.
constexpr std::uint64_t kFirstSearchWindow = 64 << 10, kMaxSearchWindow = 4 << 20;
// Bytes that may have been rewritten, and are searched again.
constexpr std::uint64_t kSearchedAgain = 256 << 10;
// The bytes that searches read in vain until the next valid record.
constexpr std::uint64_t kSearchesOfAll = 16, kSearchedInAnyFile = 64 << 20;

bool is_fragment(const RecordHeader& header) {
  return header.tag == kFragmentTag && header.flags == kCritical &&
         header.length >= kFixedBytes + kLengthBytes;
}

// Returns whether a FRAG record with an intact header begins here and fits the `left` bytes of the
// file.
bool looks_like_one(std::span<const std::uint8_t> bytes, RecordHeader& header) {
  constexpr std::uint64_t kAnyLength = std::numeric_limits<std::uint64_t>::max();
  Findings ignored(Findings::Texts::kNone);
  return bytes.size() >= kRecordHeaderBytes && ByteReader(bytes).u32() == kFragmentTag &&
         parse_record_header(bytes, 0, kAnyLength, header, ignored);
}

}  // namespace

std::vector<std::uint8_t> write_fragment(const FragmentRecord& fragment) {
  ByteWriter out;
  out.u64(fragment.offset);
  out.u32(fragment.frames);
  out.u32(fragment.flags);
  for (const float v : fragment.bounds_min) out.f32(v);
  for (const float v : fragment.bounds_max) out.f32(v);
  out.varint(fragment.primitives);
  out.u32(static_cast<std::uint32_t>(fragment.head.size()));
  out.bytes(fragment.head);
  write_links(fragment.earlier, out);
  write_node(fragment.node, out);
  out.u64(out.size() + kLengthBytes);
  return write_record(kFragmentTag, out.view());
}

void FragmentSearch::resume(std::uint64_t before, std::uint64_t now) {
  constexpr std::uint64_t kPartOfHeader = kRecordHeaderBytes - 1;
  const std::uint64_t from =
      std::min(cut_off > 0 ? cut_off : before, before - std::min(before, kPartOfHeader));
  FragmentSearch next;
  next.searched = searched;
  const auto known = results.find(before);
  if (now >= before && known != results.end() && from > known->second.end + kSearchedAgain)
    next.results[from] = known->second;
  *this = std::move(next);
}

FragmentFinder::FragmentFinder(const ByteSource& source, const FileHead& head,
                               FragmentSearch& search)
    : source_(source),
      head_(head),
      search_(search),
      body_at_(std::max<std::uint64_t>(head.bytes->size(), kHeaderBytes)) {}

// Reads the payload of an intact FRAG record. Reports why it is not valid.
bool FragmentFinder::parse(std::span<const std::uint8_t> payload, FragmentRecord& fragment,
                           Findings& findings) const {
  ByteReader in(payload);
  const std::uint64_t offset = in.u64();
  fragment.frames = in.u32();
  fragment.flags = in.u32();
  for (float& v : fragment.bounds_min) v = in.f32();
  for (float& v : fragment.bounds_max) v = in.f32();
  fragment.primitives = in.varint();
  const auto copy = in.bytes(in.u32());
  const bool own = head_.bytes->empty() ? is_usable_copy(copy, true, 0)
                                        : std::equal(copy.begin(), copy.end(), head_.bytes->begin(),
                                                     head_.bytes->end());
  if (!in.ok() || offset != fragment.offset || !own || offset < copy.size()) {
    findings.error(N::kFragment, fragment.offset, "fragment belongs to another file or place");
    return false;
  }
  FileMetadata metadata;
  std::copy_n(fragment.bounds_min, 3, metadata.scene.bounds_min);
  std::copy_n(fragment.bounds_max, 3, metadata.scene.bounds_max);
  Findings bounds;
  check_metadata_values(metadata, offset, bounds);
  ByteReader end(payload.last(kLengthBytes));
  if (fragment.frames == 0 || !bounds.ok() || end.u64() != payload.size()) {
    findings.error(N::kFragment, fragment.offset,
                   "fragment states invalid bounds, another length or 0 frames");
    return false;
  }
  fragment.head.assign(copy.begin(), copy.end());
  const NodePlace place = {offset, offset + kRecordHeaderBytes, copy.size(), offset,
                           payload.size()};
  if (!parse_links(in, place, head_, fragment.earlier, findings) ||
      !parse_node(in, place, head_, fragment.node, findings)) {
    return false;
  }
  if (in.left() >= kLengthBytes) return true;
  findings.error(N::kFragment, fragment.offset, "fragment is truncated");
  return false;
}

Result<FragmentFinder::Found> FragmentFinder::at(std::uint64_t offset,
                                                 std::optional<std::uint64_t> stated,
                                                 Findings& why) {
  if (recent_ && recent_->offset == offset && !stated) return std::exchange(recent_, {});
  const std::uint64_t size = source_.size();
  if (offset < body_at_ || offset > size) {
    why.error(N::kFragment, offset, "no fragment at byte {}", offset);
    return Found();
  }
  std::vector<std::uint8_t> bytes(std::min(kRecordHeaderBytes, size - offset));
  STGS_TRY(source_.read(offset, bytes));
  RecordHeader record;
  if (!parse_record_header(bytes, offset, size, record, why)) return Found();
  if (record.tag != kFragmentTag || (stated && record.length != *stated)) {
    why.error(N::kFragment, offset, "record '{}' of {} bytes is not the fragment that is linked to",
              tag_text(record.tag), record.length);
    return Found();
  }
  return read(offset, record, why);
}

// Returns the record of tag FRAG at `offset` whose header has been read.
Result<FragmentFinder::Found> FragmentFinder::read(std::uint64_t offset, const RecordHeader& record,
                                                   Findings& why) {
  const std::uint64_t limit = head_.limits.max_memory;
  if (record.length > limit) {
    return unsupported("index fragment of {} bytes exceeds the memory limit of {} bytes",
                       record.length, limit);
  }
  std::vector<std::uint8_t> bytes;
  STGS_TRY(read_bytes(source_, offset + kRecordHeaderBytes, record.length, bytes));
  return check(offset, record, bytes, why);
}

// Returns the record of tag FRAG at `offset`, given its payload.
Result<FragmentFinder::Found> FragmentFinder::check(std::uint64_t offset,
                                                    const RecordHeader& record,
                                                    std::span<const std::uint8_t> bytes,
                                                    Findings& why) {
  Findings found(why.texts());
  const bool is_intact = check_payload(record, bytes, offset + kRecordHeaderBytes, found);
  is_foreign_ = is_intact && ByteReader(bytes).u64() != offset;
  if (!is_fragment(record)) {
    why.error(N::kFragment, offset, "fragment with flags {:#x} and {} bytes is not valid",
              record.flags, record.length);
    return Found();
  }
  FragmentRecord fragment;
  fragment.offset = offset;
  fragment.end = offset + kRecordHeaderBytes + record.length;
  fragment.checksum = record.checksum;
  if (is_intact && parse(bytes, fragment, found)) return Found(std::move(fragment));
  if (found.code() == StatusCode::kUnsupported) return found.status(source_.name());
  why.append(std::move(found));
  return Found();
}

// Sets FragmentSearch::damaged if the bytes after a record header here state its offset, as those
// of a FRAG record do.
Status FragmentFinder::check_own_offset(std::uint64_t offset) {
  std::vector<std::uint8_t> bytes(sizeof offset);
  STGS_TRY(source_.read(offset + kRecordHeaderBytes, bytes));
  if (ByteReader(bytes).u64() == offset) search_.damaged = offset;
  return {};
}

Result<FragmentFinder::Found> FragmentFinder::last() {
  const std::uint64_t size = source_.size();
  Findings ignored;
  // A complete file ends with its last FRAG record, whose last bytes give its length.
  if (size >= body_at_ + kRecordHeaderBytes + kLengthBytes) {
    std::vector<std::uint8_t> bytes(kLengthBytes);
    STGS_TRY(source_.read(size - kLengthBytes, bytes));
    const std::uint64_t length = ByteReader(bytes).u64();
    if (length <= size - body_at_ - kRecordHeaderBytes) {
      const std::uint64_t offset = size - kRecordHeaderBytes - length;
      STGS_ASSIGN(Found found, at(offset, {}, ignored));
      search_.has_last = found && found->end == size;
      if (search_.has_last) return found;
      if (!found && length >= kFixedBytes) STGS_TRY(check_own_offset(offset));
    }
  }
  STGS_ASSIGN(const FragmentSearch::Found found, last_before(size));
  search_.has_last = true;
  return found.offset == 0 ? Found() : at(found.offset, {}, ignored);
}

Result<FragmentSearch::Found> FragmentFinder::last_before(std::uint64_t end) {
  const auto known = search_.results.lower_bound(end);
  // While a file grows, it is searched again and again.
  search_.has_ended =
      search_.has_ended || search_.searched > kSearchesOfAll * source_.size() + kSearchedInAnyFile;
  if (search_.has_ended || end <= body_at_) return FragmentSearch::Found();
  if (known != search_.results.end() && known->second.offset < end) return known->second;
  const bool is_first = known == search_.results.begin();
  const std::uint64_t low = is_first ? body_at_ : std::prev(known)->first;
  STGS_ASSIGN(FragmentSearch::Found found, search(low, end));
  if (search_.has_ended) return FragmentSearch::Found();
  if (found.offset == 0 && !is_first) found = std::prev(known)->second;
  search_.results[end] = found;
  return found;
}

// Searches [low, high) backwards, in windows of increasing size.
Result<FragmentSearch::Found> FragmentFinder::search(std::uint64_t low, std::uint64_t high) {
  std::vector<std::uint8_t> bytes;
  std::uint64_t window = kFirstSearchWindow;
  while (high > low) {
    const std::uint64_t first = high - std::min(high - low, window);
    // Includes the rest of a header that begins before `high`.
    bytes.resize(std::min(source_.size(), high + kRecordHeaderBytes - 1) - first);
    search_.searched += bytes.size();
    STGS_TRY(source_.read(first, bytes));
    for (std::uint64_t begin = high; begin-- > first;) {
      RecordHeader record;
      if (!looks_like_one(std::span(bytes).subspan(begin - first), record)) continue;
      if (record.length > source_.size() - begin - kRecordHeaderBytes) {
        search_.cut_off = begin;
        continue;
      }
      const auto after = std::span<const std::uint8_t>(bytes).subspan(begin - first);
      STGS_ASSIGN(const FragmentSearch::Found found,
                  examine(begin, record, after.subspan(kRecordHeaderBytes)));
      if (found.offset != 0 || search_.has_ended) return found;
    }
    high = first;
    window = std::min(2 * window, kMaxSearchWindow);
  }
  return FragmentSearch::Found();
}

// Returns the record at `offset` if it is valid. `after`: bytes after its header, as far as they
// have been read.
Result<FragmentSearch::Found> FragmentFinder::examine(std::uint64_t offset,
                                                      const RecordHeader& record,
                                                      std::span<const std::uint8_t> after) {
  Findings ignored(Findings::Texts::kNone);
  const bool is_read =
      record.length <= std::min<std::uint64_t>(after.size(), head_.limits.max_memory);
  STGS_ASSIGN(recent_, is_read ? check(offset, record, after.first(record.length), ignored)
                               : read(offset, record, ignored));
  if (recent_) return FragmentSearch::Found{offset, recent_->end, recent_->frames};
  search_.in_vain += record.length;
  if (!search_.has_last && !is_foreign_) search_.damaged = offset;
  search_.has_ended = search_.in_vain > source_.size();
  return FragmentSearch::Found();
}

}  // namespace stgs
