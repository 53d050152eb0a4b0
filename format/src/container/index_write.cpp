// SPDX-License-Identifier: Apache-2.0
// Writing nodes of an index (spec 5.1 to 5.3).
#include <algorithm>
#include <span>
#include <tuple>

#include "container/node.h"
#include "container/segment_keys.h"

namespace stgs {
namespace {

const IndexEntry& entry_of(const SegmentEntry& segment) {
  return segment.base;
}
const IndexEntry& entry_of(const FurtherEntry& further) {
  return further.entry;
}

// Returns the end of the entries, starting at `first`, that have the same place.
template <typename Entry>
std::size_t end_of_segment(std::span<const Entry> entries, std::size_t first) {
  const auto place = [&](std::size_t i) {
    return std::tuple(entry_of(entries[i]).level, entry_of(entries[i]).slot);
  };
  std::size_t end = first;
  while (end < entries.size() && place(end) == place(first)) ++end;
  return end;
}

// Writes a segment: its tiers and its further records; either may be empty.
void write_segment_row(std::span<const SegmentEntry> tiers, std::span<const FurtherEntry> further,
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

// Writes the segments of a run one after the other. Returns their number.
std::uint64_t write_rows(const PartEntry& part, std::span<const SegmentEntry> segments,
                         std::span<const FurtherEntry> further, ByteWriter& out) {
  SegmentKeyCoder keys;
  std::uint64_t rows = 0;
  for (std::size_t s = 0, f = 0; s < segments.size() || f < further.size(); ++rows) {
    const bool both = s < segments.size() && f < further.size();
    const double chunk = part.chunk_ticks;
    std::size_t end = s, end_more = f;
    if (s < segments.size() && !(both && comes_before(further[f].entry, segments[s].base, chunk))) {
      end = end_of_segment(segments, s);
    }
    if (f < further.size() && !(both && comes_before(segments[s].base, further[f].entry, chunk))) {
      end_more = end_of_segment(further, f);
    }
    write_segment_row(segments.subspan(s, end - s), further.subspan(f, end_more - f), keys, out);
    s = end;
    f = end_more;
  }
  return rows;
}

std::uint64_t first_offset(std::span<const SegmentEntry> segments,
                           std::span<const FurtherEntry> further) {
  if (segments.empty()) return further.front().entry.offset;
  const std::uint64_t first = segments.front().base.offset;
  return further.empty() ? first : std::min(first, further.front().entry.offset);
}

}  // namespace

void write_links(std::span<const NodeLink> links, ByteWriter& out) {
  out.varint(links.size());
  for (const NodeLink& link : links) {
    out.f64(link.needed.begin);
    out.f64(link.needed.end);
    out.varint(link.offset);
    out.varint(link.copy);
    out.varint(link.bytes);
  }
}

void write_node(const IndexNode& node, ByteWriter& out) {
  write_links(node.links, out);
  out.varint(node.runs.size());
  node.for_each_run([&](const IndexRun& run, auto segments, auto further) {
    const PartEntry& part = run.part;
    out.varint(part.number);
    for (const double v :
         {part.begin, part.end, part.displayed.begin, part.displayed.end, part.chunk_ticks}) {
      out.f64(v);
    }
    out.varint(first_offset(segments, further));
    ByteWriter rows;
    out.varint(write_rows(part, segments, further, rows));
    out.bytes(rows.view());
  });
}

std::vector<std::uint8_t> write_index(const FileIndex& index, const IndexNode& root) {
  ByteWriter out;
  out.varint(index.primitives);
  out.varint(index.attributes.size());
  for (const AttributeBytes& attribute : index.attributes) {
    out.varint(attribute.attribute);
    out.varint(attribute.bytes);
  }
  write_node(root, out);
  return out.take();
}

}  // namespace stgs
