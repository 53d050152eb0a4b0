// SPDX-License-Identifier: Apache-2.0
// Times of segments and parts (spec 5.3, 5.4), and the order of an index.
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "container/container.h"

namespace stgs {
namespace {

// Returns 2^exponent, for exponents of normal numbers.
double power_of_two(int exponent) {
  return std::bit_cast<double>(static_cast<std::uint64_t>(1023 + exponent) << 52);
}

// Returns the beginnings of the ranges of items that are sorted by a key, and the end of the last.
template <typename Item, typename KeyOf>
std::vector<std::size_t> sorted_ranges(const std::vector<Item>& items, const KeyOf& key_of) {
  std::vector<std::size_t> ranges = {0};
  for (std::size_t i = 1; i < items.size(); ++i) {
    if (key_of(items[i]) < key_of(items[i - 1])) ranges.push_back(i);
  }
  ranges.push_back(items.size());
  return ranges;
}

// Returns the numbers of ranges, with the keys of their first items, in the order of both.
template <typename Item, typename KeyOf>
auto order_of(const std::vector<Item>& items, const std::vector<std::size_t>& ranges,
              const KeyOf& key_of) {
  std::vector<std::pair<decltype(key_of(items[0])), std::size_t>> order;
  order.reserve(ranges.size() - 1);
  for (std::size_t r = 0; r + 1 < ranges.size(); ++r)
    order.emplace_back(key_of(items[ranges[r]]), r);
  std::sort(order.begin(), order.end());
  return order;
}

// Puts items into the order of `ranges`, which are consecutive, of a permutation: order[i].second
// is the number of the range that becomes the i-th one. Needs 4 bytes for each item.
template <typename Item, typename Order>
void arrange(std::vector<Item>& items, const std::vector<std::size_t>& ranges, const Order& order) {
  std::vector<std::uint32_t> from;  // for each place: the item that belongs there
  from.reserve(items.size());
  for (const auto& [key, r] : order) {
    for (std::size_t i = ranges[r]; i < ranges[r + 1]; ++i)
      from.push_back(static_cast<std::uint32_t>(i));
  }
  for (std::uint32_t start = 0; start < from.size(); ++start) {
    if (from[start] == start) continue;
    const Item first = items[start];
    std::uint32_t at = start;
    for (std::uint32_t next = from[at]; next != start; next = from[at]) {
      items[at] = items[next];
      from[at] = at;
      at = next;
    }
    items[at] = first;
    from[at] = at;
  }
}

// Sorts items by a key. Equal ones stay in their order. Items of an index are usually sorted, or
// consist of sorted ranges that do not overlap: then only the ranges are sorted.
template <typename Item, typename KeyOf>
void sort_by(std::vector<Item>& items, const KeyOf& key_of) {
  std::vector<std::size_t> ranges = sorted_ranges(items, key_of);
  if (ranges.size() == 2) return;
  auto order = order_of(items, ranges, key_of);
  const auto overlap = [&](const auto& a, const auto& b) {
    return b < std::pair(key_of(items[ranges[a.second + 1] - 1]), a.second);
  };
  if (std::adjacent_find(order.begin(), order.end(), overlap) != order.end()) {
    ranges.resize(items.size() + 1);
    std::iota(ranges.begin(), ranges.end(), std::size_t{0});
    order = order_of(items, ranges, key_of);
  }
  arrange(items, ranges, order);
}

}  // namespace

double begin_of(int level, std::uint32_t slot, double chunk_ticks) {
  return level < 0 ? 0.0 : slot * (chunk_ticks * power_of_two(level - 1));
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
  return {begin, std::min(begin + chunk_ticks * power_of_two(level), length)};
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

TickRange needed_in(const IndexNode& node, double frames) {
  TickRange all = kNever;
  node.for_each_run([&](const IndexRun& run, auto segments, auto others) {
    const auto add = [&](const IndexEntry& entry) {
      if (const auto needed = needed_times(entry, run.part, frames)) extend(all, needed->range);
    };
    for (const SegmentEntry& segment : segments) add(segment.base);
    for (const FurtherEntry& further : others) add(further.entry);
  });
  return all;
}

TickRange needed_of(const IndexNode& node) {
  TickRange all = kNever;
  for (const NodeLink& link : node.links) extend(all, link.needed);
  node.for_each_run([&](const IndexRun& run, auto segments, auto others) {
    for (const SegmentEntry& segment : segments) extend(all, needed_of(segment.base, run.part));
    for (const FurtherEntry& further : others) extend(all, needed_of(further.entry, run.part));
  });
  return all.begin <= all.end ? all : TickRange{0, 0};
}

std::vector<RecordRange*> records_of(FileIndex& index) {
  std::vector<RecordRange*> records;
  records.reserve(index.segments.size() + index.further.size());
  for (SegmentEntry& segment : index.segments) {
    records.push_back(&segment.base);
    if (segment.sh.bytes > 0) records.push_back(&segment.sh);
  }
  for (FurtherEntry& further : index.further) records.push_back(&further.entry);
  sort_by(records, [](const RecordRange* record) { return record->offset; });
  return records;
}

namespace {

// Returns whether the segments are sorted by part and offset, and their parts by number, as a
// writer leaves them.
bool is_in_order(const FileIndex& index) {
  if (!index.further.empty()) return false;
  if (index.segments.empty()) return true;
  if (index.segments[0].part != 0) return false;
  std::uint32_t part = 0;
  std::uint64_t first = index.segments[0].base.offset, last = first;  // offsets in that part
  for (const SegmentEntry& segment : index.segments) {
    const std::uint64_t offset = segment.base.offset;
    if (segment.part != part) {
      if (segment.part != part + 1 || offset < first) return false;
      part = segment.part;
      first = offset;
    } else if (offset < last) {
      return false;
    }
    last = offset;
  }
  return true;
}

}  // namespace

void sort_index(std::vector<PartEntry>& parts, FileIndex& index) {
  if (is_in_order(index)) return;
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
  for (SegmentEntry& segment : index.segments) segment.part = number[segment.part];
  for (FurtherEntry& further : index.further) further.part = number[further.part];
  sort_by(index.segments, [](const SegmentEntry& e) { return std::pair(e.part, e.base.offset); });
  sort_by(index.further, [](const FurtherEntry& e) { return std::pair(e.part, e.entry.offset); });
}

}  // namespace stgs
