// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <set>
#include <tuple>

#include "container/node.h"
#include "describe.h"
#include "sha256.h"

namespace stgs::testing {
namespace {

// A segment with its tiers, as indices of the head's index.
struct Segment {
  std::uint32_t part = 0;  // index into the parts of the head
  IndexEntry first;        // its first record
  std::vector<std::uint32_t> tiers, further;
};

void describe_links(const FileHead& head, Description& out) {
  std::set<std::tuple<std::uint64_t, std::uint64_t, std::uint64_t, std::string>> links;
  const auto add = [&links](const std::vector<NodeLink>& all) {
    for (const NodeLink& link : all) {
      links.emplace(link.offset, link.copy, link.bytes,
                    bits_text(link.needed.begin) + " " + bits_text(link.needed.end));
    }
  };
  for (const auto& [record, node] : head.walk.nodes) add(node.links);
  add(head.walk.earlier);
  for (const auto& [offset, copy, bytes, times] : links)
    out.line("link {} {} {} {}", offset, copy, bytes, times);
}

void describe_parts(const FileHead& head, Description& out) {
  std::set<std::array<std::int64_t, 6>> parts;
  for (const PartEntry& part : head.parts) {
    parts.insert({part.number, to_units(part.begin, 20), to_units(part.end, 20),
                  to_units(part.displayed.begin, 20), to_units(part.displayed.end, 20),
                  to_units(part.chunk_ticks, 20)});
  }
  for (const auto& [number, begin, end, from, to, chunk] : parts)
    out.line("part {} {} {} {} {} {}", number, begin, end, from, to, chunk);
}

// Returns the segments by part, level, slot and offset.
std::vector<Segment> segments_of(const FileHead& head) {
  std::map<std::uint32_t, Segment> found;  // by number
  const auto add = [&](const IndexEntry& entry, std::uint32_t part, std::uint32_t number) -> auto& {
    Segment& segment = found[number];
    if (segment.first.bytes == 0 || entry.offset < segment.first.offset) segment.first = entry;
    segment.part = part;
    return segment;
  };
  const FileIndex& index = head.index;
  for (std::uint32_t i = 0; i < index.segments.size(); ++i) {
    const SegmentEntry& tier = index.segments[i];
    add(tier.base, tier.part, tier.number).tiers.push_back(i);
  }
  for (std::uint32_t i = 0; i < index.further.size(); ++i) {
    const FurtherEntry& further = index.further[i];
    add(further.entry, further.part, further.number).further.push_back(i);
  }
  std::vector<Segment> out;
  for (auto& [number, segment] : found) out.push_back(std::move(segment));
  std::stable_sort(out.begin(), out.end(), [&head](const Segment& a, const Segment& b) {
    const auto key = [&head](const Segment& s) {
      return std::tuple(head.parts[s.part].number, s.first.level, s.first.slot, s.first.offset);
    };
    return key(a) < key(b);
  });
  return out;
}

// Returns NEEDED (conformance.md 3.2).
std::string needed_text(const FileHead& head, const Segment& segment) {
  const PartEntry& part = head.parts[segment.part];
  const auto needed = needed_times(segment.first, part, head.metadata.scene.frames);
  if (!needed) return "never";
  return fmt::format("{} {} {}", to_units(needed->range.begin, 21), to_units(needed->range.end, 21),
                     needed->closed ? "closed" : "open");
}

void describe_further(const OpenFile& file, const FurtherEntry& further, const std::string& place,
                      Description& out) {
  if (content_of(further.entry.layer) < kFirstPrivateContent) return;
  FurtherRecord record;
  Findings findings;
  const std::string name = fmt::format("{} {}", place, further.entry.layer);
  if (!read_further(*file.source, file.head, further, record, findings))
    return out.refuse("further " + name, findings.status(file.source->name()));
  out.line("further {} {} {} {} {}", name, bits_text(record.times.begin),
           bits_text(record.times.end), bytes_text(record.type), sha256(record.data));
}

}  // namespace

void describe_index(const OpenFile& file, Description& out) {
  const FileHead& head = file.head;
  describe_links(head, out);
  for (const IndexWalk::Lost& lost : head.walk.lost) {
    out.line("refused {} {}: damaged (issue {})", head.growing() ? "fragment" : "page", lost.record,
             lost.issue);
  }
  describe_parts(head, out);
  for (const Segment& segment : segments_of(head)) {
    const IndexEntry& first = segment.first;
    const std::string place =
        fmt::format("{} {} {}", head.parts[segment.part].number, first.level, first.slot);
    const TickRange interval = interval_of(head, first, segment.part);
    out.line("segment {} {} {} {}", place, to_units(interval.begin, 21), to_units(interval.end, 21),
             needed_text(head, segment));
    for (const std::uint32_t tier : segment.tiers) {
      const IndexEntry& entry = head.index.segments[tier].base;
      const std::string name = fmt::format("{} {}", place, tier_of(entry.layer));
      out.line("tier {} {} {}", name, entry.offset, entry.primitives);
      describe_tier(file, tier, name, out);
    }
    for (const std::uint32_t further : segment.further)
      describe_further(file, head.index.further[further], place, out);
  }
}

}  // namespace stgs::testing
