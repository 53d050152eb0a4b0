// SPDX-License-Identifier: Apache-2.0
#include "scene/recorded_segments.h"

#include <algorithm>

namespace stgs {
namespace {

// An end with the key of its record.
struct KeyedEnd {
  TierKey tier;
  std::uint32_t frame = 0, primitive = 0;
  auto operator<=>(const KeyedEnd&) const = default;
};

// Returns the lists of ends that are sorted and unique; their times count from frame `begin`.
std::vector<EndList> lists_of(std::span<const KeyedEnd> ends, std::uint32_t begin) {
  std::vector<EndList> lists;
  for (const KeyedEnd& end : ends) {
    const std::uint32_t time = end.frame - begin;
    if (lists.empty() || lists.back().tier != end.tier || lists.back().time != time)
      lists.push_back({end.tier, time, {}});
    lists.back().primitives.push_back(end.primitive);
  }
  return lists;
}

}  // namespace

void append_records(Body& body, std::uint64_t begin, std::vector<std::uint8_t>& bytes) {
  std::vector<SegmentEntry>& segments = body.index.segments;
  const auto add = [&](const std::vector<std::uint8_t>& record, RecordRange& entry) {
    entry.offset = begin + bytes.size();
    bytes.insert(bytes.end(), record.begin(), record.end());
  };
  for (std::size_t first = 0, end = 0; first < segments.size(); first = end) {
    const IndexEntry place = segments[first].base;
    const auto is_here = [&place](const SegmentEntry& segment) {
      return segment.base.level == place.level && segment.base.slot == place.slot;
    };
    while (end < segments.size() && is_here(segments[end])) ++end;
    for (std::size_t s = first; s < end; ++s) add(body.bases[s], segments[s].base);
    for (std::size_t s = first; s < end; ++s) add(body.sh[s], segments[s].sh);
  }
}

void RecordedSegments::add(std::uint32_t part, const IndexEntry& base) {
  segments_[base.offset] = {tier_key(part, base), base.primitives};
}

void locate(const Body& body, std::vector<StoredPrimitive>& locations) {
  auto primitive = body.order.begin();
  for (const SegmentEntry& segment : body.index.segments) {
    for (std::uint32_t i = 0; i < segment.base.primitives; ++i)
      locations[*primitive++] = {segment.base.offset, i};
  }
}

Status RecordedSegments::check(const std::string& name, std::span<const PrimitiveEnd> ends,
                               std::uint32_t end_frame) const {
  if (ends.size() > kMaxEnds) {
    return usage_error("{}: {} ends are too many for one fragment (at most {})", name, ends.size(),
                       kMaxEnds);
  }
  for (const PrimitiveEnd& end : ends) {
    const auto [record, index] = end.primitive;
    if (end.frame > end_frame) {
      return usage_error("{}: a primitive cannot end at frame {} in a fragment that ends at {}",
                         name, end.frame, end_frame);
    }
    const auto found = segments_.find(record);
    if (found != segments_.end() && index < found->second.primitives) continue;
    return usage_error(
        "{}: no primitive {} is stored in a record at byte {}; use the locations "
        "that append() returned",
        name, index, record);
  }
  return {};
}

EndRecord RecordedSegments::record_of(std::span<const PrimitiveEnd> ends,
                                      double chunk_ticks) const {
  std::vector<KeyedEnd> keyed;
  keyed.reserve(ends.size());
  std::uint32_t begin = ends.front().frame;
  for (const PrimitiveEnd& end : ends) {
    keyed.push_back({segments_.at(end.primitive.record).tier, end.frame, end.primitive.index});
    begin = std::min(begin, end.frame);
  }
  std::sort(keyed.begin(), keyed.end());
  keyed.erase(std::unique(keyed.begin(), keyed.end()), keyed.end());
  EndRecord out;
  out.part.begin = begin;
  out.part.end = kMaxChunk;
  out.part.displayed = {out.part.begin, out.part.end};
  out.part.chunk_ticks = chunk_ticks;
  IndexEntry& entry = out.entry.entry;
  entry.level = -1;
  entry.layer = layer_of(Content::kEnds, 0);
  out.bytes = write_record(kSegmentTag, write_ends(entry, lists_of(keyed, begin)));
  entry.bytes = out.bytes.size();
  return out;
}

}  // namespace stgs
