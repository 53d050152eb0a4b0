// SPDX-License-Identifier: Apache-2.0
#include "container/ends.h"

#include <algorithm>
#include <limits>
#include <tuple>

#include "container/node.h"
#include "container/opening.h"
#include "container/segment.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint64_t kListBytes = 6;  // of a list, at least
constexpr std::uint64_t kMaxU32 = std::numeric_limits<std::uint32_t>::max();

// Reads the lists of a record of ends.
class EndReader {
 public:
  explicit EndReader(ByteReader& in) : in_(in) {}

  // Returns null, or what is wrong.
  const char* read(std::vector<EndList>& lists) {
    const std::uint64_t count = in_.varint();
    if (in_.ok() && count == 0) return "without lists";
    lists.reserve(
        static_cast<std::size_t>(std::min<std::uint64_t>(count, in_.left() / kListBytes)));
    for (std::uint64_t i = 0; i < count && in_.ok(); ++i) {
      EndList list;
      if (const char* problem = read_list(list)) return problem;
      if (!lists.empty() && !comes_after(list, lists.back())) return "with lists out of order";
      lists.push_back(std::move(list));
    }
    return in_.ok() ? nullptr : kTruncated;
  }

 private:
  static constexpr const char* kTruncated =
      "that is truncated, or has a number that is not in its shortest form";

  static bool comes_after(const EndList& list, const EndList& before) {
    return std::tie(list.tier, list.time) > std::tie(before.tier, before.time);
  }

  const char* read_list(EndList& list) {
    const std::uint64_t part = in_.varint(), place = in_.varint(), tier = in_.varint();
    const std::uint64_t time = in_.varint(), count = in_.varint();
    if (!in_.ok()) return kTruncated;
    if (part > kMaxU32 || place >> 5 > kMaxU32 || tier >= kMaxTiers || time > kMaxU32)
      return "with a number out of range";
    if (count == 0) return "with an empty list";
    if (count > kMaxEnds - ends_) return "of more than 2^20 ends";
    ends_ += count;
    list.tier = {static_cast<std::uint32_t>(part), place, static_cast<std::uint32_t>(tier)};
    list.time = static_cast<std::uint32_t>(time);
    if (count > in_.left()) return kTruncated;  // before anything is allocated
    list.primitives.reserve(static_cast<std::size_t>(count));
    std::uint64_t next = 0;  // the least index that may follow
    for (std::uint64_t i = 0; i < count && in_.ok(); ++i) {
      const std::uint64_t skipped = in_.varint();
      if (skipped > kMaxU32 || next + skipped > kMaxU32) return "with a number out of range";
      next += skipped;
      list.primitives.push_back(static_cast<std::uint32_t>(next++));
    }
    return in_.ok() ? nullptr : kTruncated;
  }

  ByteReader& in_;
  std::uint64_t ends_ = 0;
};

}  // namespace

TierKey tier_key(std::uint32_t part, const IndexEntry& base) {
  const std::uint64_t level = static_cast<unsigned>(base.level + 1);
  return {part, std::uint64_t{base.slot} << 5 | level,
          static_cast<std::uint32_t>(tier_of(base.layer))};
}

std::vector<std::uint8_t> write_ends(const IndexEntry& entry, std::span<const EndList> lists) {
  ByteWriter out;
  out.u16(static_cast<std::uint16_t>(entry.level));
  out.u16(entry.layer);
  out.u32(entry.slot);
  out.varint(lists.size());
  for (const EndList& list : lists) {
    for (const std::uint64_t v :
         {std::uint64_t{list.tier.part}, list.tier.place, std::uint64_t{list.tier.tier},
          std::uint64_t{list.time}, std::uint64_t{list.primitives.size()}}) {
      out.varint(v);
    }
    std::uint32_t next = 0;
    for (const std::uint32_t primitive : list.primitives) {
      out.varint(primitive - next);
      next = primitive + 1;
    }
  }
  return out.take();
}

bool parse_ends(std::span<const std::uint8_t> payload, const IndexEntry& entry,
                std::uint64_t offset, std::vector<EndList>& lists, Findings& findings) {
  ByteReader in(payload);
  const auto level = static_cast<std::int16_t>(in.u16());
  const std::uint16_t layer = in.u16();
  const std::uint32_t slot = in.u32();
  if (in.ok() && (level != entry.level || layer != entry.layer || slot != entry.slot)) {
    findings.error(N::kSegmentMismatch, offset, "record of ends does not match its index entry");
    return false;
  }
  const char* const problem = EndReader(in).read(lists);
  if (problem == nullptr) return true;
  findings.error(N::kEnds, offset + in.position(), "record of ends {}", problem);
  return false;
}

namespace {

// Reads a record whose bytes are counted.
bool read_ends(const ByteSource& source, const FurtherEntry& further, const FileHead& head,
               std::vector<EndList>& lists, Findings& findings) {
  const IndexEntry& entry = further.entry;
  if ((head.header.flags & kHasEnds) == 0) {
    findings.error(N::kEnds, entry.offset, "the file header states that there are no ends");
    return false;
  }
  std::vector<std::uint8_t> bytes;
  if (!read_listed(source, head, entry, bytes, findings)) return false;
  return parse_ends(std::span<const std::uint8_t>(bytes).subspan(kRecordHeaderBytes), entry,
                    entry.offset + kRecordHeaderBytes, lists, findings);
}

}  // namespace

bool load_ends(const ByteSource& source, const FurtherEntry& further, FileHead& head,
               Findings& findings) {
  const std::uint64_t at = further.entry.offset, payload = further.entry.bytes - kRecordHeaderBytes;
  if (!take_node(at, payload, head, findings)) return false;
  head.walk.opening_bytes += kOpeningEndByte * payload;
  if (!fits_opening(head, 0, 0, at, findings)) return false;
  auto loaded = std::make_shared<LoadedEnds>();
  Findings found;
  if (read_ends(source, further, head, loaded->lists, found)) {
    loaded->offset = at;
    loaded->begin = head.parts[further.part].begin;
    head.ends.push_back(std::move(loaded));
    return true;
  }
  const bool is_damage =
      found.code() == StatusCode::kInvalidFile || found.code() == StatusCode::kUnsupported;
  if (!is_damage) return findings.append(std::move(found)), false;
  const Issue why = found.take().front();
  findings.damage(N::kEnds, why.offset,
                  "ends cannot be read: {}; their primitives are displayed longer", why.message);
  return true;
}

std::vector<SegmentEnd> ends_of(const FileHead& head, const SegmentEntry& segment) {
  const PartEntry& part = head.parts[segment.part];
  const TierKey key = tier_key(part.number, segment.base);
  std::vector<SegmentEnd> ends;
  for (const auto& loaded : head.ends) {
    auto list = std::lower_bound(loaded->lists.begin(), loaded->lists.end(), key,
                                 [](const EndList& one, const TierKey& k) { return one.tier < k; });
    for (; list != loaded->lists.end() && list->tier == key; ++list) {
      const double ticks = loaded->begin + list->time - part.begin;
      for (const std::uint32_t primitive : list->primitives)
        if (primitive < segment.base.primitives) ends.push_back({primitive, ticks});
    }
  }
  // The first end of each.
  std::sort(ends.begin(), ends.end(), [](const SegmentEnd& a, const SegmentEnd& b) {
    return std::tie(a.primitive, a.ticks) < std::tie(b.primitive, b.ticks);
  });
  const auto same = [](const SegmentEnd& a, const SegmentEnd& b) {
    return a.primitive == b.primitive;
  };
  ends.erase(std::unique(ends.begin(), ends.end(), same), ends.end());
  return ends;
}

}  // namespace stgs
