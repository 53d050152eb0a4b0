// SPDX-License-Identifier: Apache-2.0
// Clause 5.12: the index of a growing file, in FRAG records.
#include <algorithm>

#include "interchange/stgs1/file.h"

namespace stgs::stgs1 {
namespace {

constexpr std::uint64_t kMinLength = 72;  // of the payload; its last 8 bytes are its length
constexpr std::uint64_t kLast = 8;
constexpr std::uint32_t kClosed = 1, kCriticalFlags = 0xFFFF;
constexpr std::uint64_t kWindowBytes = std::uint64_t{1} << 20;  // of a search backwards

struct Fragment {
  std::uint64_t offset = 0, end = 0;
  std::uint32_t frames = 0, flags = 0;
  float bounds[6] = {};
  std::uint64_t previous = 0, before = 0;
  Bytes payload;
  std::size_t index_at = 0, index_bytes = 0;  // with additions of later versions
  Lease lease = {};                           // of the payload

  View index() const { return View(payload).subspan(index_at, index_bytes); }
};
using FoundFragment = std::optional<Fragment>;

bool is_fragment(const Record& record) {
  return record.tag == tag("FRAG") && record.flags == kCriticalFlag && record.length >= kMinLength;
}

// Finds the FRAG records of a file.
class FragmentSearch {
 public:
  FragmentSearch(const File& file, std::uint64_t head_sum)
      : file_(file), head_sum_(head_sum), budget_(2 * file.source.size() + 4 * kWindowBytes) {}

  // Returns the last complete fragment.
  Result<FoundFragment> last() {
    const std::uint64_t size = file_.source.size();
    if (size >= file_.head_bytes + kRecord + kLast) {
      Bytes bytes;
      STGS_TRY(read_bytes(file_.source, size - kLast, kLast, bytes));
      const std::uint64_t length = ByteReader(bytes).u64();
      if (length <= size - kRecord - file_.head_bytes) {
        STGS_ASSIGN(FoundFragment found, reachable_at(size - kRecord - length, size));
        if (found) return found;
      }
    }
    return last_before(size);
  }

  // Returns the valid FRAG record at `offset` that ends at or before `end`.
  Result<FoundFragment> valid_at(std::uint64_t offset, std::uint64_t end) {
    STGS_ASSIGN(const std::optional<Record> record, body_record(offset, end));
    if (!record || !is_fragment(*record)) return FoundFragment();
    STGS_TRY(spend(record->length));
    Fragment found;
    STGS_ASSIGN(found.lease, file_.memory.take(record->length + 3 * sizeof(Fragment),
                                               "the fragments of the index"));
    Bytes& payload = found.payload;
    STGS_TRY(read_bytes(file_.source, record->payload(), record->length, payload));
    if (checksum(payload) != record->checksum) return FoundFragment();
    ByteReader in(payload);
    found.offset = offset;
    found.end = record->end();
    found.frames = in.u32();
    found.flags = in.u32();
    for (float& v : found.bounds) v = in.f32();
    const std::uint64_t own = in.u64(), head = in.u64();
    found.previous = in.u64();
    found.before = in.u64();
    found.index_at = payload.size() - in.left();
    found.index_bytes = in.left() - kLast;
    return own == offset && head == head_sum_ ? FoundFragment(std::move(found)) : FoundFragment();
  }

  // Returns the reachable one that begins last of those that end at or before `end`.
  Result<FoundFragment> last_before(std::uint64_t end) {
    STGS_ASSIGN(const Lease lease,
                file_.memory.take(std::min(end, kWindowBytes + kRecord), "the bytes of the body"));
    Bytes bytes;
    for (std::uint64_t high = end; high > file_.head_bytes;) {
      const std::uint64_t low = high - std::min(high - file_.head_bytes, kWindowBytes);
      // Includes the rest of a header that begins before `high`.
      STGS_TRY(read_bytes(file_.source, low, std::min(end, high + kRecord - 1) - low, bytes));
      for (std::uint64_t at = high; at-- > low;) {
        const View here = View(bytes).subspan(static_cast<std::size_t>(at - low));
        if (here[0] != 'F' || here.size() < kRecord || ByteReader(here).u32() != tag("FRAG") ||
            !parse_record(here, at, end)) {
          continue;
        }
        STGS_ASSIGN(FoundFragment found, reachable_at(at, end));
        if (found) return found;
      }
      high = low;
    }
    return FoundFragment();
  }

 private:
  // Limits the work for records that only resemble fragments.
  Status spend(std::uint64_t bytes) {
    if (bytes > budget_) return invalid_file("too many records resemble fragments of the index");
    budget_ -= bytes;
    return {};
  }

  Result<std::optional<Record>> body_record(std::uint64_t offset, std::uint64_t end) const {
    if (offset < file_.head_bytes) return std::optional<Record>();
    return record_at(file_.source, offset, end);
  }

  Result<FoundFragment> reachable_at(std::uint64_t offset, std::uint64_t end) {
    STGS_ASSIGN(FoundFragment found, valid_at(offset, end));
    if (!found) return found;
    STGS_ASSIGN(const bool is_reached, is_reachable(*found));
    return is_reached ? std::move(found) : FoundFragment();
  }

  // Returns whether records lead to a valid FRAG record. Otherwise it may be part of the payload of
  // another one.
  Result<bool> is_reachable(const Fragment& fragment) {
    std::uint64_t at = file_.head_bytes;
    if (fragment.before != 0) {
      STGS_ASSIGN(const auto before, body_record(fragment.before, fragment.offset));
      if (!before || !is_fragment(*before)) return false;
      at = before->end();
    }
    const std::uint64_t first = at;
    while (at != fragment.offset) {
      STGS_ASSIGN(const auto record, body_record(at, fragment.offset));
      if (!record) return lists_a_record(fragment, first);
      if (record->tag == tag("SEGM") && record->flags == kCriticalFlag) break;
      STGS_TRY(spend(kRecord));
      at = record->end();
    }
    return true;
  }

  // Returns whether a record that it lists, at or after `first`, has a valid header. Files of
  // version 1.0 do not have this rule.
  Result<bool> lists_a_record(const Fragment& fragment, std::uint64_t first) {
    if (file_.minor < 1) return false;
    File listed{file_.source, file_.memory};
    const std::uint64_t begin = fragment.previous != 0 ? fragment.previous : file_.head_bytes;
    if (!read_index(fragment.index(), begin, fragment.offset, listed).ok()) return false;
    for (const Tier& tier : listed.tiers) {
      if (tier.base.offset < first) continue;
      STGS_TRY(spend(kRecord));
      STGS_ASSIGN(const auto record, body_record(tier.base.offset, fragment.offset));
      if (record && record->tag == tag("SEGM") && record->flags == kCriticalFlag) return true;
    }
    return false;
  }

  const File& file_;
  std::uint64_t head_sum_;
  std::uint64_t budget_;  // bytes
};

// Notes the bytes after the complete content.
void note_incomplete(File& file) {
  const std::uint64_t bytes = file.source.size() - file.end;
  if (bytes == 0) return;
  file.notes.push_back(
      fmt::format("ignored {} {} of a fragment that is not complete: the recording was interrupted",
                  bytes, bytes == 1 ? "byte" : "bytes"));
}

// Takes end, frames and bounds from the last fragment.
Status take_last(const Fragment& last, File& file) {
  file.end = last.end;
  const std::uint64_t after = file.source.size() - last.end;
  if (after > 0 && (last.flags & kClosed) != 0) {
    file.damage.push_back(
        fmt::format("{} bytes after the end of the recording; copy or download "
                    "it again",
                    after));
  } else {
    note_incomplete(file);
  }
  if (last.frames == 0) return invalid_file("a fragment states 0 frames [byte {}]", last.offset);
  file.metadata.frames = last.frames;
  std::copy_n(last.bounds, 3, file.metadata.bounds_min);
  std::copy_n(last.bounds + 3, 3, file.metadata.bounds_max);
  return check_bounds(file.metadata);
}

// Collects the fragments whose parts make up the index, earliest first.
Status collect(FragmentSearch& search, Fragment last, File& file, std::vector<Fragment>& chain) {
  // Each of the chain is charged, with its place in the list.
  chain.push_back(std::move(last));
  while (chain.back().previous != 0) {
    const std::uint64_t previous = chain.back().previous;
    if (previous < file.head_bytes || previous >= chain.back().offset) {
      return invalid_file("a fragment follows one at byte {} [byte {}]", previous,
                          chain.back().offset);
    }
    STGS_ASSIGN(FoundFragment found, search.valid_at(previous, chain.back().offset));
    if (!found) {
      file.damage.push_back(fmt::format(
          "a fragment is damaged; content that it alone lists is lost [byte {}]", previous));
      STGS_ASSIGN(found, search.last_before(previous));
      if (!found) break;
    }
    chain.push_back(std::move(*found));
  }
  std::reverse(chain.begin(), chain.end());
  return {};
}

}  // namespace

Status read_fragments(File& file, std::uint64_t head_sum) {
  file.end = file.body_at = file.head_bytes;
  FragmentSearch search(file, head_sum);
  STGS_ASSIGN(FoundFragment last, search.last());
  if (!last) {  // only the head and its copy are complete
    file.parts.push_back({0, static_cast<double>(file.metadata.frames), 0, {}});
    STGS_ASSIGN(const auto copy, record_at(file.source, file.end, file.source.size()));
    if (copy && copy->tag == tag("COPY") && copy->flags == 0 && copy->length >= kHeader + kLast)
      file.end = copy->end();
    note_incomplete(file);
    return {};
  }
  STGS_TRY(take_last(*last, file));
  std::vector<Fragment> chain;
  STGS_TRY(collect(search, std::move(*last), file, chain));
  for (const Fragment& fragment : chain) {
    if ((fragment.flags & kCriticalFlags & ~kClosed) != 0) {
      return unsupported("a fragment has unknown critical flags {:#x} [byte {}]", fragment.flags,
                         fragment.offset);
    }
    if ((fragment.flags & kClosed) != 0 && &fragment != &chain.back()) {
      return invalid_file("a fragment follows a closed one [byte {}]", fragment.end);
    }
    const std::uint64_t begin = fragment.previous != 0 ? fragment.previous : file.head_bytes;
    STGS_TRY(read_index(fragment.index(), begin, fragment.offset, file));
  }
  return {};
}

}  // namespace stgs::stgs1
