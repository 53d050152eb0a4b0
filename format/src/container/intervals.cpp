// SPDX-License-Identifier: Apache-2.0
// Times of segments and parts (spec 5.3, 5.4), and the order of an index.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "container/container.h"

namespace stgs {

double begin_of(int level, std::uint32_t slot, double chunk_ticks) {
  return level < 0 ? 0.0 : slot * std::ldexp(chunk_ticks, level - 1);
}

bool is_chunk(double ticks) {
  return ticks >= kChunkGrain && ticks <= kMaxChunk && std::fmod(ticks, kChunkGrain) == 0.0;
}

double to_chunk(double ticks) {
  return ticks > 0.0 ? std::max(kChunkGrain, std::round(ticks / kChunkGrain) * kChunkGrain) : 0.0;
}

bool is_valid_time(double ticks) {
  return std::abs(ticks) <= kMaxChunk && std::fmod(ticks, kChunkGrain) == 0.0;
}

bool is_valid_part(const PartEntry& part) {
  const auto [from, to] = part.displayed;
  return is_valid_time(part.begin) && is_valid_time(part.end) && is_valid_time(from) &&
         is_valid_time(to) && part.begin < part.end && part.end - part.begin <= kMaxChunk &&
         0.0 <= from && part.begin <= from && from < to && to <= part.end;
}

TickRange interval_of(int level, std::uint32_t slot, double chunk_ticks, double length) {
  if (level < 0) return {0.0, length};
  const double begin = begin_of(level, slot, chunk_ticks);
  return {begin, std::min(begin + std::ldexp(chunk_ticks, level), length)};
}

TickRange interval_of(const FileHead& head, const IndexEntry& entry, std::uint32_t part) {
  return interval_of(entry.level, entry.slot, head.chunk_of(part),
                     head.parts[part].end - head.parts[part].begin);
}

TickRange needed_of(const TickRange& interval, const TickRange& part,
                    const std::optional<TickRange>& cut) {
  const TickRange displayed = cut.value_or(TickRange{std::max(part.begin, 0.0), part.end});
  return {std::max(part.begin + interval.begin, displayed.begin),
          std::min(part.begin + interval.end, displayed.end)};
}

TickRange needed_of(const IndexEntry& entry, const PartEntry& part) {
  return needed_of(interval_of(entry.level, entry.slot, part.chunk_ticks, part.end - part.begin),
                   {part.begin, part.end}, part.displayed);
}

TickRange needed_of(const FileHead& head, const SegmentEntry& segment) {
  return needed_of(segment.base, head.parts[segment.part]);
}

bool is_end_needed(const TickRange& needed, const PartEntry& part, double frames) {
  return needed.end < part.displayed.end || part.displayed.end >= frames;
}

namespace {

constexpr TickRange kNever = {std::numeric_limits<double>::infinity(),
                              -std::numeric_limits<double>::infinity()};

// Extends a closed range to contain another one.
void extend(TickRange& all, const TickRange& range) {
  if (range.begin > range.end) return;
  all = {std::min(all.begin, range.begin), std::max(all.end, range.end)};
}

}  // namespace

std::optional<NeededTimes> needed_times(const IndexEntry& entry, const PartEntry& part,
                                        double frames) {
  TickRange needed = needed_of(entry, part);
  needed.end = std::min(needed.end, frames);
  const bool closed = is_end_needed(needed, part, frames);
  if (needed.begin > needed.end || (needed.begin == needed.end && !closed)) return {};
  return NeededTimes{needed, closed};
}

TickRange needed_in(const std::vector<IndexRun>& runs, double frames) {
  TickRange all = kNever;
  const auto add = [&](const IndexEntry& entry, const PartEntry& part) {
    if (const auto needed = needed_times(entry, part, frames)) extend(all, needed->range);
  };
  for (const IndexRun& run : runs) {
    for (const SegmentEntry& segment : run.segments) add(segment.base, run.part);
    for (const FurtherEntry& further : run.further) add(further.entry, run.part);
  }
  return all;
}

TickRange needed_of(const IndexNode& node) {
  TickRange all = kNever;
  for (const NodeLink& link : node.links) extend(all, link.needed);
  for (const IndexRun& run : node.runs) {
    for (const SegmentEntry& segment : run.segments) extend(all, needed_of(segment.base, run.part));
    for (const FurtherEntry& further : run.further) extend(all, needed_of(further.entry, run.part));
  }
  return all.begin <= all.end ? all : TickRange{0, 0};
}

std::vector<IndexEntry*> records_of(FileIndex& index) {
  std::vector<IndexEntry*> records;
  for (SegmentEntry& segment : index.segments) {
    records.push_back(&segment.base);
    if (segment.sh.bytes > 0) records.push_back(&segment.sh);
  }
  for (FurtherEntry& further : index.further) records.push_back(&further.entry);
  std::sort(records.begin(), records.end(),
            [](const IndexEntry* a, const IndexEntry* b) { return a->offset < b->offset; });
  return records;
}

void sort_index(std::vector<PartEntry>& parts, FileIndex& index) {
  std::vector<std::uint64_t> first(parts.size(), std::numeric_limits<std::uint64_t>::max());
  const auto note = [&first](std::uint32_t part, const IndexEntry& entry) {
    first[part] = std::min(first[part], entry.offset);
  };
  for (const SegmentEntry& segment : index.segments) note(segment.part, segment.base);
  for (const FurtherEntry& further : index.further) note(further.part, further.entry);
  std::vector<std::uint32_t> order(parts.size()), number(parts.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&first](std::uint32_t a, std::uint32_t b) { return first[a] < first[b]; });
  std::vector<PartEntry> sorted;
  for (const std::uint32_t part : order) {
    number[part] = static_cast<std::uint32_t>(sorted.size());
    sorted.push_back(parts[part]);
  }
  parts = std::move(sorted);
  const auto sort = [&number](auto& entries, const auto& offset_of) {
    for (auto& entry : entries) entry.part = number[entry.part];
    std::stable_sort(entries.begin(), entries.end(), [&offset_of](const auto& a, const auto& b) {
      return a.part != b.part ? a.part < b.part : offset_of(a) < offset_of(b);
    });
  };
  sort(index.segments, [](const SegmentEntry& e) { return e.base.offset; });
  sort(index.further, [](const FurtherEntry& e) { return e.entry.offset; });
}

}  // namespace stgs
