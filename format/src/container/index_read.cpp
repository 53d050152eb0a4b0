// SPDX-License-Identifier: Apache-2.0
// Reading INDX: the records of all segments (spec 5).
#include <algorithm>
#include <limits>

#include "container/container.h"
#include "container/segment_keys.h"
#include "core/bytes.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr std::uint64_t kMaxTotals = 1024;  // spec 5.2

class IndexReader {
 public:
  IndexReader(std::span<const std::uint8_t> payload, std::uint64_t offset, const RecordArea& area,
              FileHead& head, Findings& findings)
      : in_(payload),
        offset_(offset),
        at_(area.begin),
        end_(area.end),
        head_(head),
        findings_(findings) {}

  bool read() {
    FileIndex& index = head_.index;
    const double chunk = in_.f64();
    const std::uint64_t stated = in_.varint();
    const std::uint64_t attributes = in_.varint();
    if (!in_.ok() || attributes > kMaxTotals || !read_totals(attributes)) return cut_off();
    const std::uint64_t parts = in_.varint();
    if (!in_.ok()) return cut_off();
    if (!is_chunk(chunk) || (!head_.parts.empty() && chunk != index.chunk_ticks)) {
      findings_.error(N::kChunk, offset_, "index: invalid chunk length of {} ticks", chunk);
      return false;
    }
    index.chunk_ticks = chunk;
    const std::size_t first = ordinal();
    for (std::uint64_t p = 0; p < parts; ++p) {
      if (!read_part()) return false;
    }
    std::uint64_t total = 0;
    for (std::size_t i = first; i < ordinal(); ++i) total += index.segments[i].base.primitives;
    index.primitives += total;
    if (total != stated) {
      findings_.error(N::kPrimitiveTotal, offset_,
                      "index: primitive count mismatch (total states {}, segments have {})", stated,
                      total);
    }
    return true;
  }

 private:
  std::uint64_t here() const { return offset_ + in_.position(); }

  bool cut_off() {
    findings_.error(N::kIndexLayout, here(),
                    "index: truncated, or a number is not in its shortest form");
    return false;
  }

  // Adds to the existing totals: each fragment of an index states its own.
  bool read_totals(std::uint64_t count) {
    std::vector<AttributeBytes>& rows = head_.index.attributes;
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint64_t attribute = in_.varint(), bytes = in_.varint();
      if (!in_.ok() || attribute > std::numeric_limits<std::uint16_t>::max()) return false;
      const auto row = std::find_if(rows.begin(), rows.end(), [attribute](const auto& r) {
        return r.attribute == attribute;
      });
      if (row != rows.end()) {
        row->bytes += bytes;
      } else {
        rows.push_back({static_cast<std::uint16_t>(attribute), bytes});
      }
    }
    return true;
  }

  bool read_part() {  // spec 5.3
    const std::uint64_t at = here();
    PartEntry part;
    part.begin = in_.f64();
    part.end = in_.f64();
    const std::uint64_t skip = in_.varint();
    part.skip = skip >> kSkipShift;
    if ((skip & kHasCut) != 0) part.cut = {in_.f64(), in_.f64()};
    if ((skip & kHasChunk) != 0) part.chunk_ticks = in_.f64();
    const std::uint64_t segments = in_.varint();
    if (!in_.ok()) return cut_off();
    if ((skip & kHasChunk) != 0 && !is_chunk(part.chunk_ticks)) {
      findings_.error(N::kChunk, at, "index: part {} has an invalid chunk length of {} ticks",
                      head_.parts.size(), part.chunk_ticks);
      return false;
    }
    const TickRange shown = part.cut.value_or(TickRange{std::max(part.begin, 0.0), part.end});
    const bool valid = is_valid_time(part.begin) && is_valid_time(part.end) &&
                       is_valid_time(shown.begin) && is_valid_time(shown.end) &&
                       part.end - part.begin <= kMaxChunk;
    if (!valid || !(part.begin < part.end) ||
        (part.cut && !(shown.begin >= std::max(part.begin, 0.0) && shown.begin < shown.end &&
                       shown.end <= part.end))) {
      findings_.error(N::kParts, at,
                      "index: part {} has an invalid range (ticks {} to {}, shown from {} to {})",
                      head_.parts.size(), part.begin, part.end, shown.begin, shown.end);
      return false;
    }
    if (!advance(part.skip, at) || !take_entry(at)) return false;
    head_.parts.push_back(part);
    SegmentKeyCoder keys;
    last_.reset();
    for (std::uint64_t s = 0; s < segments; ++s) {
      if (!read_segment(keys)) return false;
    }
    return true;
  }

  // Checks that one more entry stays within the memory limit (conformance 1.5).
  bool take_entry(std::uint64_t at) {
    const FileIndex& index = head_.index;
    const std::uint64_t entries =
        head_.parts.size() + index.segments.size() + index.further.size() + 1;
    const std::uint64_t limit = head_.limits.max_memory;
    if (entries <= kFreeEntries || entries - kFreeEntries <= limit / kEntryMemory) return true;
    findings_.unsupported(N::kMemoryLimit, at,
                          "index: {} entries exceed the memory limit of {} bytes", entries, limit);
    return false;
  }

  // Skips bytes of the body.
  bool advance(std::uint64_t bytes, std::uint64_t at) {
    if (bytes <= end_ - at_) {
      at_ += bytes;
      return true;
    }
    findings_.error(N::kSegmentRange, at,
                    "index: {} bytes at byte {} exceed the body, which ends at byte {}", bytes, at_,
                    end_);
    return false;
  }

  // Reads the payload length of the next record and sets its range.
  bool take_record(IndexEntry& entry, std::uint64_t at) {
    const std::uint64_t payload = in_.varint();
    if (!in_.ok()) return cut_off();
    entry.offset = at_;
    if (!advance(kRecordHeaderBytes, at) || !advance(payload, at)) return false;
    entry.bytes = kRecordHeaderBytes + payload;
    return true;
  }

  bool read_segment(SegmentKeyCoder& keys) {  // spec 5.3
    const std::uint64_t at = here();
    const std::uint64_t number = in_.varint(), shape = in_.varint();
    if (!in_.ok()) return cut_off();
    SegmentEntry segment;
    segment.part = static_cast<std::uint32_t>(head_.parts.size() - 1);
    IndexEntry& base = segment.base;
    if (!keys.decode(number, base) || empty(interval_of(head_, base, segment.part))) {
      findings_.error(N::kSegmentInterval, at, "index: segment {} is outside its part", ordinal());
      return false;
    }
    if (last_ && !comes_before(*last_, base, head_.chunk_of(segment.part))) {
      findings_.error(N::kSegmentOrder, at, "index: segment {} is out of order", ordinal());
      return false;
    }
    last_ = base;
    const std::uint64_t tiers = shape >> 2;
    if (tiers > kMaxTiers || (tiers == 0 && (shape & 3) != kHasFurther)) {
      findings_.error(N::kIndexLayout, at,
                      "index: segment {} has {} tiers (expected at most {}) or no records",
                      ordinal(), tiers, kMaxTiers);
      return false;
    }
    const std::size_t first = head_.index.segments.size();
    for (std::uint64_t t = 0; t < tiers; ++t) {
      base.layer = layer_of(Content::kPrimitives, static_cast<int>(t));
      if (!take_primitives(base, at) || !take_record(base, at) || !enough_bytes(base, at) ||
          !take_entry(at)) {
        return false;
      }
      head_.index.segments.push_back(segment);
    }
    for (std::size_t i = first; (shape & kSeparateSh) != 0 && i < first + tiers; ++i) {
      SegmentEntry& tier = head_.index.segments[i];
      IndexEntry sh = tier.base;
      sh.layer = layer_of(Content::kSh, tier_of(tier.base.layer));
      if (!take_record(sh, at) || !enough_bytes(sh, at)) return false;
      tier.sh = sh;
    }
    return (shape & kHasFurther) == 0 || take_further(base, segment.part, at);
  }

  // Reads the entries of records of unknown content, which this version ignores (spec 5.7).
  bool take_further(IndexEntry entry, std::uint32_t part, std::uint64_t at) {
    const std::uint64_t records = in_.varint();
    if (records == 0) {
      findings_.error(N::kIndexLayout, at, "index: segment {} states 0 further records", ordinal());
      return false;
    }
    for (std::uint64_t i = 0; i < records; ++i) {
      const std::uint64_t layer = in_.varint();
      if (in_.ok() && (layer > std::numeric_limits<std::uint16_t>::max() ||
                       content_of(static_cast<std::uint16_t>(layer)) <= kMaxKnownContent)) {
        findings_.error(N::kSegmentOrder, at, "index: layer {} is invalid for a further record",
                        layer);
        return false;
      }
      entry.layer = static_cast<std::uint16_t>(layer);
      entry.primitives = 0;
      if (!take_record(entry, at) || !take_entry(at)) return false;
      head_.index.further.push_back({entry, part});
    }
    return in_.ok() || cut_off();
  }

  bool take_primitives(IndexEntry& entry, std::uint64_t at) {
    const std::uint64_t primitives = in_.varint();
    if (!in_.ok()) return cut_off();
    if (primitives == 0 || primitives > std::numeric_limits<std::uint32_t>::max()) {
      findings_.error(N::kSegmentCount, at,
                      "index: segment {} has {} primitives (expected 1 to 2^32 - 1)", ordinal(),
                      primitives);
      return false;
    }
    entry.primitives = static_cast<std::uint32_t>(primitives);
    return true;
  }

  bool enough_bytes(const IndexEntry& entry, std::uint64_t at) {  // spec 5.5
    if (content_of(entry.layer) != static_cast<int>(Content::kPrimitives) ||
        entry.primitives <=
            kMaxPrimitivesPerByte *
                std::min<std::uint64_t>(std::numeric_limits<std::uint32_t>::max(), entry.bytes)) {
      return true;
    }
    findings_.error(N::kSegmentCount, at,
                    "index: segment {} states {} primitives, too many for {} bytes", ordinal(),
                    entry.primitives, entry.bytes);
    return false;
  }

  std::size_t ordinal() const { return head_.index.segments.size(); }
  static bool empty(const TickRange& interval) { return !(interval.begin < interval.end); }

  ByteReader in_;
  std::uint64_t offset_;            // of the payload
  std::uint64_t at_, end_;          // beginning of the next record; end of the body
  std::optional<IndexEntry> last_;  // key of the previous segment of the same part
  FileHead& head_;
  Findings& findings_;
};

}  // namespace

bool parse_index(std::span<const std::uint8_t> payload, std::uint64_t offset,
                 const RecordArea& area, FileHead& head, Findings& findings) {
  return IndexReader(payload, offset, area, head, findings).read();
}

void check_index(const FileHead& head, std::uint64_t offset, const ReadLimits& limits,
                 Findings& findings) {
  const FileIndex& index = head.index;
  const std::uint64_t bytes = 4 * floats_per_primitive(head.metadata.sh_degree);
  for (std::size_t i = 0; i < index.segments.size(); ++i) {
    const IndexEntry& entry = index.segments[i].base;
    if (entry.primitives > limits.max_memory / bytes) {
      findings.unsupported(N::kMemoryLimit, offset,
                           "index: segment {} needs {} bytes, more than the memory limit of {}", i,
                           entry.primitives * bytes, limits.max_memory);
    }
  }
  if (index.primitives > limits.max_primitives) {
    findings.unsupported(N::kPrimitiveLimit, offset, "index: {} primitives exceed the limit of {}",
                         index.primitives, limits.max_primitives);
  }
}

}  // namespace stgs
