// SPDX-License-Identifier: Apache-2.0
// Times of segments and parts (spec 5.2 to 5.4).
#include <algorithm>
#include <cmath>

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

TickRange interval_of(int level, std::uint32_t slot, double chunk_ticks, double length) {
  if (level < 0) return {0.0, length};
  const double begin = begin_of(level, slot, chunk_ticks);
  return {begin, std::min(begin + std::ldexp(chunk_ticks, level), length)};
}

TickRange interval_of(const FileHead& head, const IndexEntry& entry, std::uint32_t part) {
  return interval_of(entry.level, entry.slot, head.chunk_of(part),
                     head.parts[part].end - head.parts[part].begin);
}

TickRange shown_of(const FileHead& head, const SegmentEntry& segment) {
  const PartEntry& part = head.parts[segment.part];
  return shown_of(interval_of(head, segment.base, segment.part), {part.begin, part.end}, part.cut);
}

TickRange shown_of(const TickRange& interval, const TickRange& part,
                   const std::optional<TickRange>& cut) {
  const TickRange shown = cut.value_or(TickRange{part.begin, part.end});
  return {std::max({0.0, part.begin + interval.begin, shown.begin}),
          std::min(part.begin + interval.end, shown.end)};
}

}  // namespace stgs
