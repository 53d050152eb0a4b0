// SPDX-License-Identifier: Apache-2.0
// INDX: which records hold what is alive when (spec 5).
#include <algorithm>
#include <limits>

#include "bytes.h"
#include "container.h"

namespace stgs {
namespace {

using N = IssueNumber;

constexpr int kMaxLevel = 30;
constexpr std::uint64_t kMaxTotals = 1024;      // spec 5.2
constexpr std::uint64_t kApart = 1, kMore = 2;  // bits of a segment's shape, spec 5.3
constexpr std::uint64_t kCut = 1, kChunk = 2;   // bits beside a part's skip
constexpr int kSkipShift = 2;

bool persistent(const IndexEntry& entry) {
  return entry.level < 0;
}

// Order of the segments of a part: by beginning, the longer first (spec 5.6).
bool comes_before(const IndexEntry& a, const IndexEntry& b, double chunk) {
  if (persistent(a) || persistent(b)) return persistent(a) && !persistent(b);
  const double begin_a = begin_of(a.level, a.slot, chunk);
  const double begin_b = begin_of(b.level, b.slot, chunk);
  return begin_a != begin_b ? begin_a < begin_b : a.level > b.level;
}

// The place of a segment as one number: small where it follows the last one of its level in a part.
class Places {
 public:
  std::uint64_t number_of(const IndexEntry& entry) {
    std::uint64_t& next = next_[static_cast<std::size_t>(entry.level + 1)];
    const std::uint64_t number = (entry.slot - next) << 5 | static_cast<unsigned>(entry.level + 1);
    next = std::uint64_t{entry.slot} + 1;
    return number;
  }
  // False where there is no such slot.
  bool place_of(std::uint64_t number, IndexEntry& entry) {
    std::uint64_t& next = next_[number & 31];
    const std::uint64_t step = number >> 5;
    const std::uint64_t last = (number & 31) == 0 ? 0 : std::numeric_limits<std::uint32_t>::max();
    if (next > last || step > last - next) return false;
    entry.level = static_cast<std::int16_t>(static_cast<int>(number & 31) - 1);
    entry.slot = static_cast<std::uint32_t>(next + step);
    next = std::uint64_t{entry.slot} + 1;
    return true;
  }

 private:
  std::array<std::uint64_t, kMaxLevel + 2> next_{};
};

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
      findings_.error(N::kChunk, offset_, "index: a chunk of {} ticks", chunk);
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
                      "index: the segments hold {} primitives, the total says {}", total, stated);
    }
    return true;
  }

 private:
  std::uint64_t here() const { return offset_ + in_.position(); }

  bool cut_off() {
    findings_.error(N::kIndexLayout, here(),
                    "index: cut off, or with a number of more bytes than it needs");
    return false;
  }

  // Adds to the totals that there are: the fragments of an index tell each its own.
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
    if ((skip & kCut) != 0) part.cut = {in_.f64(), in_.f64()};
    if ((skip & kChunk) != 0) part.chunk_ticks = in_.f64();
    const std::uint64_t segments = in_.varint();
    if (!in_.ok()) return cut_off();
    if ((skip & kChunk) != 0 && !is_chunk(part.chunk_ticks)) {
      findings_.error(N::kChunk, at, "index: part {} has a chunk of {} ticks", head_.parts.size(),
                      part.chunk_ticks);
      return false;
    }
    const TickRange shown = part.cut.value_or(TickRange{std::max(part.begin, 0.0), part.end});
    const bool moments = is_moment(part.begin) && is_moment(part.end) && is_moment(shown.begin) &&
                         is_moment(shown.end) && part.end - part.begin <= kMostChunk;
    if (!moments || !(part.begin < part.end) ||
        (part.cut && !(shown.begin >= std::max(part.begin, 0.0) && shown.begin < shown.end &&
                       shown.end <= part.end))) {
      findings_.error(N::kParts, at,
                      "index: part {} lasts from {} to {} and is shown from {} to {}",
                      head_.parts.size(), part.begin, part.end, shown.begin, shown.end);
      return false;
    }
    if (!advance(part.skip, at)) return false;
    head_.parts.push_back(part);
    Places places;
    last_.reset();
    for (std::uint64_t s = 0; s < segments; ++s) {
      if (!read_segment(places)) return false;
    }
    return true;
  }

  // Moves over bytes of the body.
  bool advance(std::uint64_t bytes, std::uint64_t at) {
    if (bytes <= end_ - at_) {
      at_ += bytes;
      return true;
    }
    findings_.error(N::kSegmentRange, at,
                    "index: {} bytes from byte {} on do not lie in the body, which ends at {}",
                    bytes, at_, end_);
    return false;
  }

  // The record that comes next, of which the index tells the bytes of the payload.
  bool take_record(IndexEntry& entry, std::uint64_t at) {
    const std::uint64_t payload = in_.varint();
    if (!in_.ok()) return cut_off();
    entry.offset = at_;
    if (!advance(kRecordHeaderBytes, at) || !advance(payload, at)) return false;
    entry.bytes = kRecordHeaderBytes + payload;
    return true;
  }

  bool read_segment(Places& places) {  // spec 5.3
    const std::uint64_t at = here();
    const std::uint64_t number = in_.varint(), shape = in_.varint();
    if (!in_.ok()) return cut_off();
    SegmentEntry segment;
    segment.part = static_cast<std::uint32_t>(head_.parts.size() - 1);
    IndexEntry& base = segment.base;
    if (!places.place_of(number, base) || empty(interval_of(head_, base, segment.part))) {
      findings_.error(N::kSegmentInterval, at, "index: segment {} lies outside its part",
                      ordinal());
      return false;
    }
    if (last_ && !comes_before(*last_, base, head_.chunk_of(segment.part))) {
      findings_.error(N::kSegmentOrder, at, "index: segment {} is out of order", ordinal());
      return false;
    }
    last_ = base;
    const std::uint64_t tiers = shape >> 2;
    if (tiers > kMaxTiers || (tiers == 0 && (shape & 3) != kMore)) {
      findings_.error(N::kIndexLayout, at, "index: segment {} has {} tiers, or no records",
                      ordinal(), tiers);
      return false;
    }
    const std::size_t first = head_.index.segments.size();
    for (std::uint64_t t = 0; t < tiers; ++t) {
      base.layer = layer_of(Content::kPrimitives, static_cast<int>(t));
      if (!take_primitives(base, at) || !take_record(base, at) || !enough_bytes(base, at)) {
        return false;
      }
      head_.index.segments.push_back(segment);
    }
    for (std::size_t i = first; (shape & kApart) != 0 && i < first + tiers; ++i) {
      SegmentEntry& tier = head_.index.segments[i];
      IndexEntry harmonics = tier.base;
      harmonics.layer = layer_of(Content::kHarmonics, tier_of(tier.base.layer));
      if (!take_record(harmonics, at) || !enough_bytes(harmonics, at)) return false;
      tier.harmonics = harmonics;
    }
    return (shape & kMore) == 0 || take_further(base, segment.part, at);
  }

  // What this version does not know, and does without (spec 5.7).
  bool take_further(IndexEntry entry, std::uint32_t part, std::uint64_t at) {
    const std::uint64_t records = in_.varint();
    if (records == 0) {
      findings_.error(N::kIndexLayout, at, "index: segment {} has no further records", ordinal());
      return false;
    }
    for (std::uint64_t i = 0; i < records; ++i) {
      const std::uint64_t layer = in_.varint();
      if (in_.ok() && (layer > std::numeric_limits<std::uint16_t>::max() ||
                       content_of(static_cast<std::uint16_t>(layer)) <= kLastContent)) {
        findings_.error(N::kSegmentOrder, at, "index: layer {} is not a refinement's", layer);
        return false;
      }
      entry.layer = static_cast<std::uint16_t>(layer);
      entry.primitives = 0;
      if (!take_record(entry, at)) return false;
      head_.index.further.push_back({entry, part});
    }
    return in_.ok() || cut_off();
  }

  bool take_primitives(IndexEntry& entry, std::uint64_t at) {
    const std::uint64_t primitives = in_.varint();
    if (!in_.ok()) return cut_off();
    if (primitives == 0 || primitives > std::numeric_limits<std::uint32_t>::max()) {
      findings_.error(N::kSegmentCount, at, "index: segment {} has {} primitives", ordinal(),
                      primitives);
      return false;
    }
    entry.primitives = static_cast<std::uint32_t>(primitives);
    return true;
  }

  bool enough_bytes(const IndexEntry& entry, std::uint64_t at) {  // spec 5.5
    if (entry.primitives <=
        kMostPrimitivesPerByte *
            std::min<std::uint64_t>(std::numeric_limits<std::uint32_t>::max(), entry.bytes)) {
      return true;
    }
    findings_.error(N::kSegmentCount, at, "index: segment {} claims {} primitives in {} bytes",
                    ordinal(), entry.primitives, entry.bytes);
    return false;
  }

  std::size_t ordinal() const { return head_.index.segments.size(); }
  static bool empty(const Interval& interval) { return !(interval.begin < interval.end); }

  ByteReader in_;
  std::uint64_t offset_;            // of the payload
  std::uint64_t at_, end_;          // where the next record begins and the last may end
  std::optional<IndexEntry> last_;  // the place of the segment before, of the same part
  FileHead& head_;
  Findings& findings_;
};

const IndexEntry& entry_of(const SegmentEntry& segment) {
  return segment.base;
}
const IndexEntry& entry_of(const FurtherEntry& further) {
  return further.entry;
}

// The entries from `first` on that are of its part and place: one past the last.
template <typename Entry>
std::size_t end_of_run(std::span<const Entry> entries, std::size_t first) {
  const auto place = [&](std::size_t i) {
    const IndexEntry& entry = entry_of(entries[i]);
    return std::tuple(entries[i].part, entry.level, entry.slot);
  };
  std::size_t end = first;
  while (end < entries.size() && place(end) == place(first)) ++end;
  return end;
}

// A segment: its tiers and its further records, of which one or the other may be none.
void write_run(std::span<const SegmentEntry> tiers, std::span<const FurtherEntry> further,
               Places& places, ByteWriter& out) {
  const bool apart = !tiers.empty() && tiers[0].harmonics.bytes > 0;
  out.varint(places.number_of(tiers.empty() ? further[0].entry : tiers[0].base));
  out.varint(tiers.size() << 2 | (further.empty() ? 0 : kMore) | (apart ? kApart : 0));
  for (const SegmentEntry& tier : tiers) {
    out.varint(tier.base.primitives);
    out.varint(tier.base.bytes - kRecordHeaderBytes);
  }
  for (const SegmentEntry& tier : tiers) {
    if (apart) out.varint(tier.harmonics.bytes - kRecordHeaderBytes);
  }
  if (!further.empty()) out.varint(further.size());
  for (const FurtherEntry& record : further) {
    out.varint(record.entry.layer);
    out.varint(record.entry.bytes - kRecordHeaderBytes);
  }
}

// Takes the segments of an index one after the other, in the order of the file.
class Runs {
 public:
  explicit Runs(const FileIndex& index) : segments_(index.segments), further_(index.further) {}

  // Writes the next segment of a part of this chunk; false where there is none.
  bool write_next(std::uint32_t part, double chunk, Places& places, ByteWriter& out) {
    const bool tiers = segment_ < segments_.size() && segments_[segment_].part == part;
    const bool more = record_ < further_.size() && further_[record_].part == part;
    if (!tiers && !more) return false;
    const auto before = [chunk](const IndexEntry& a, const IndexEntry& b) {
      return comes_before(a, b, chunk);
    };
    std::size_t end = segment_, end_more = record_;
    if (tiers && !(more && before(further_[record_].entry, segments_[segment_].base))) {
      end = end_of_run(segments_, segment_);
    }
    if (more && !(tiers && before(segments_[segment_].base, further_[record_].entry))) {
      end_more = end_of_run(further_, record_);
    }
    write_run(segments_.subspan(segment_, end - segment_),
              further_.subspan(record_, end_more - record_), places, out);
    segment_ = end;
    record_ = end_more;
    return true;
  }

 private:
  std::span<const SegmentEntry> segments_;
  std::span<const FurtherEntry> further_;
  std::size_t segment_ = 0, record_ = 0;
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
                           "index: segment {} needs {} bytes of memory, more than the limit of {}",
                           i, entry.primitives * bytes, limits.max_memory);
    }
  }
  if (index.primitives > limits.max_primitives) {
    findings.unsupported(N::kPrimitiveLimit, offset,
                         "index: {} primitives, more than the limit of {}", index.primitives,
                         limits.max_primitives);
  }
}

std::vector<std::uint8_t> write_index(const FileIndex& index, std::span<const PartEntry> parts) {
  ByteWriter out;
  out.f64(index.chunk_ticks);
  out.varint(index.primitives);
  out.varint(index.attributes.size());
  for (const AttributeBytes& attribute : index.attributes) {
    out.varint(attribute.attribute);
    out.varint(attribute.bytes);
  }
  out.varint(parts.size());
  Runs segments(index);
  for (std::uint32_t p = 0; p < parts.size(); ++p) {
    out.f64(parts[p].begin);
    out.f64(parts[p].end);
    const bool own_chunk = parts[p].chunk_ticks > 0;
    out.varint(parts[p].skip << kSkipShift | (own_chunk ? kChunk : 0) | (parts[p].cut ? kCut : 0));
    if (parts[p].cut) {
      out.f64(parts[p].cut->begin);
      out.f64(parts[p].cut->end);
    }
    if (own_chunk) out.f64(parts[p].chunk_ticks);
    ByteWriter rows;
    std::uint64_t runs = 0;
    Places places;
    const double chunk = own_chunk ? parts[p].chunk_ticks : index.chunk_ticks;
    while (segments.write_next(p, chunk, places, rows)) ++runs;
    out.varint(runs);
    out.bytes(rows.view());
  }
  return out.take();
}

std::vector<IndexEntry*> records_of(std::vector<SegmentEntry>& segments) {
  std::vector<IndexEntry*> records;
  for (std::size_t begin = 0; begin < segments.size();) {
    const std::size_t end = end_of_run(std::span<const SegmentEntry>(segments), begin);
    for (std::size_t i = begin; i < end; ++i) records.push_back(&segments[i].base);
    for (; begin < end; ++begin) {
      if (segments[begin].harmonics.bytes > 0) records.push_back(&segments[begin].harmonics);
    }
  }
  return records;
}

}  // namespace stgs
