// SPDX-License-Identifier: Apache-2.0
// Writing INDX (spec 5.2, 5.3).
#include <span>
#include <tuple>

#include "container/container.h"
#include "container/segment_keys.h"
#include "core/bytes.h"

namespace stgs {
namespace {

const IndexEntry& entry_of(const SegmentEntry& segment) {
  return segment.base;
}
const IndexEntry& entry_of(const FurtherEntry& further) {
  return further.entry;
}

// Returns the end of the run of entries, starting at `first`, with the same part and key.
template <typename Entry>
std::size_t end_of_run(std::span<const Entry> entries, std::size_t first) {
  const auto key = [&](std::size_t i) {
    const IndexEntry& entry = entry_of(entries[i]);
    return std::tuple(entries[i].part, entry.level, entry.slot);
  };
  std::size_t end = first;
  while (end < entries.size() && key(end) == key(first)) ++end;
  return end;
}

// Writes a segment: its tiers and its further records; either may be empty.
void write_run(std::span<const SegmentEntry> tiers, std::span<const FurtherEntry> further,
               SegmentKeyCoder& keys, ByteWriter& out) {
  const bool separate_sh = !tiers.empty() && tiers[0].sh.bytes > 0;
  out.varint(keys.encode(tiers.empty() ? further[0].entry : tiers[0].base));
  out.varint(tiers.size() << 2 | (further.empty() ? 0 : kHasFurther) |
             (separate_sh ? kSeparateSh : 0));
  for (const SegmentEntry& tier : tiers) {
    out.varint(tier.base.primitives);
    out.varint(tier.base.bytes - kRecordHeaderBytes);
  }
  for (const SegmentEntry& tier : tiers) {
    if (separate_sh) out.varint(tier.sh.bytes - kRecordHeaderBytes);
  }
  if (!further.empty()) out.varint(further.size());
  for (const FurtherEntry& record : further) {
    out.varint(record.entry.layer);
    out.varint(record.entry.bytes - kRecordHeaderBytes);
  }
}

// Writes the segments of an index one after the other, in file order.
class Runs {
 public:
  explicit Runs(const FileIndex& index) : segments_(index.segments), further_(index.further) {}

  // Writes the next segment of a part with this chunk. Returns false if there is none.
  bool write_next(std::uint32_t part, double chunk, SegmentKeyCoder& keys, ByteWriter& out) {
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
              further_.subspan(record_, end_more - record_), keys, out);
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
    out.varint(parts[p].skip << kSkipShift | (own_chunk ? kHasChunk : 0) |
               (parts[p].cut ? kHasCut : 0));
    if (parts[p].cut) {
      out.f64(parts[p].cut->begin);
      out.f64(parts[p].cut->end);
    }
    if (own_chunk) out.f64(parts[p].chunk_ticks);
    ByteWriter rows;
    std::uint64_t runs = 0;
    SegmentKeyCoder keys;
    const double chunk = own_chunk ? parts[p].chunk_ticks : index.chunk_ticks;
    while (segments.write_next(p, chunk, keys, rows)) ++runs;
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
      if (segments[begin].sh.bytes > 0) records.push_back(&segments[begin].sh);
    }
  }
  return records;
}

}  // namespace stgs
