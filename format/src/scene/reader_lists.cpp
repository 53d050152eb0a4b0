// SPDX-License-Identifier: Apache-2.0
#include "scene/reader_lists.h"

#include <algorithm>
#include <limits>
#include <map>
#include <set>

namespace stgs {
namespace {

constexpr std::uint32_t kNoNumber = std::numeric_limits<std::uint32_t>::max();

// Returns the numbers of the parts in ReaderLists::parts. Parts that contain ends alone have none.
std::vector<std::uint32_t> part_numbers(const FileHead& head) {
  std::vector<std::uint32_t> out(head.parts.size(), kNoNumber);
  for (const SegmentEntry& segment : head.index.segments) out[segment.part] = 0;
  for (const FurtherEntry& further : head.index.further)
    if (!is_ends(further.entry)) out[further.part] = 0;
  std::uint32_t next = 0;
  for (std::uint32_t& number : out)
    if (number != kNoNumber) number = next++;
  return out;
}

std::vector<SegmentInfo> segments_from(const FileHead& head,
                                       const std::vector<std::uint32_t>& numbers) {
  std::vector<SegmentInfo> out;
  out.reserve(head.index.segments.size());
  const SegmentEntry* before = nullptr;
  TickRange needed;
  bool needed_at_end = false;
  for (const SegmentEntry& segment : head.index.segments) {
    const IndexEntry& base = segment.base;
    const RecordRange& sh = segment.sh;
    // The tiers of a segment are needed at the same times.
    if (before == nullptr || before->number != segment.number) {
      needed = needed_of(head, segment);
      needed_at_end = is_end_needed(needed, head.parts[segment.part], head.metadata.scene.frames);
    }
    before = &segment;
    out.push_back({base.level, base.primitives, needed.begin, needed.end, base.offset, base.bytes,
                   sh.offset, sh.bytes, numbers[segment.part],
                   static_cast<std::uint8_t>(tier_of(base.layer)), head.has(base), head.has(sh),
                   needed_at_end});
  }
  return out;
}

std::vector<ScenePart> parts_from(const FileHead& head, const std::vector<std::uint32_t>& numbers) {
  std::vector<ScenePart> out;
  for (std::size_t p = 0; p < head.parts.size(); ++p) {
    if (numbers[p] == kNoNumber) continue;
    const PartEntry& part = head.parts[p];
    const bool complete = part.displayed == TickRange{std::max(part.begin, 0.0), part.end};
    out.push_back(
        {part.begin, part.end, 0, complete ? std::nullopt : std::optional(part.displayed)});
  }
  for (const SegmentEntry& segment : head.index.segments) {
    out[numbers[segment.part]].primitives += segment.base.primitives;
  }
  return out;
}

// Returns the time up to which nothing is missing.
double complete_ticks_of(const FileHead& head, const std::vector<SegmentInfo>& segments) {
  double ticks = head.metadata.scene.frames;
  for (const LostFragment& lost : head.lost_fragments) ticks = std::min(ticks, lost.range.begin);
  for (const SegmentInfo& segment : segments) {
    const bool complete = segment.available && segment.sh_available;
    if (segment.is_needed() && !complete) ticks = std::min(ticks, segment.begin_ticks);
  }
  return ticks;
}

}  // namespace

std::vector<std::uint32_t> ended_segments(const FileHead& head, std::vector<std::uint64_t> known) {
  std::sort(known.begin(), known.end());
  std::set<TierKey> ended;
  for (const auto& ends : head.ends) {
    if (std::binary_search(known.begin(), known.end(), ends->offset)) continue;
    for (const EndList& list : ends->lists) ended.insert(list.tier);
  }
  std::vector<std::uint32_t> out;
  for (std::uint32_t s = 0; !ended.empty() && s < head.index.segments.size(); ++s) {
    const SegmentEntry& segment = head.index.segments[s];
    if (ended.contains(tier_key(head.parts[segment.part].number, segment.base)))
      out.push_back(head.index.first + s);
  }
  return out;
}

ListedSegment listed_segment(const FileHead& head, std::uint32_t number) {
  const SegmentEntry& segment = head.segment(number);
  const IndexEntry& base = segment.base;
  const PartEntry& part = head.parts[segment.part];
  return {number,           base.slot,   base.primitives, base.level,
          base.layer,       base.offset, base.bytes,      segment.sh.offset,
          segment.sh.bytes, part.begin,  part.end,        part.chunk_ticks};
}

void replace_segments(const ListedSegment& segment, std::span<const SegmentEnd> ends,
                      FileHead& head) {
  const RecordRange base = {segment.offset, segment.bytes};
  const RecordRange sh = {segment.sh_offset, segment.sh_bytes};
  const TickRange displayed = {segment.part_begin, segment.part_end};
  head.parts = {{0, segment.part_begin, segment.part_end, displayed, segment.chunk_ticks}};
  head.index.first = segment.number;
  head.index.segments = {
      {{base, segment.level, segment.layer, segment.slot, segment.primitives}, sh}};
  head.index.further.clear();  // of other parts
  head.walk.pending.clear();
  std::map<double, EndList> lists;  // by time
  for (const SegmentEnd& end : ends) lists[end.ticks].primitives.push_back(end.primitive);
  head.ends.clear();
  for (auto& [ticks, list] : lists) {
    list.tier = tier_key(0, head.index.segments.front().base);
    head.ends.push_back(
        std::make_shared<LoadedEnds>(LoadedEnds{0, segment.part_begin + ticks, {std::move(list)}}));
  }
  for (const RecordRange& record : {base, sh})
    head.available_bytes = std::max(head.available_bytes, record.offset + record.bytes);
}

ReaderLists::ReaderLists(const FileHead& head) : ReaderLists(head, part_numbers(head)) {}

ReaderLists::ReaderLists(const FileHead& head, const std::vector<std::uint32_t>& numbers)
    : segments(segments_from(head, numbers)),
      times(segments, static_cast<double>(head.metadata.scene.frames)),
      parts(parts_from(head, numbers)),
      complete_ticks(complete_ticks_of(head, segments)) {
  for (const ScenePart& part : parts) latest_begin = std::max(latest_begin, part.begin_ticks);
}

}  // namespace stgs
