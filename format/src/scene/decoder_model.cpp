// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/decoder_model.h"

#include <algorithm>
#include <functional>
#include <queue>
#include <tuple>
#include <utility>
#include <vector>

#include "container/container.h"

namespace stgs {
namespace {

// spec/decoder-model.md, 3.
struct Level {
  std::uint64_t primitives, bytes, index_bytes;
  double bits_per_second, primitives_per_second;
};
constexpr std::uint64_t kMinSegmentWork = 1000;  // lowest work of a segment, primitives
// Work and minimum size of a table in a record's own layout: primitives, bytes.
constexpr std::uint64_t kTableWork = 64, kTableBytes = 3;
constexpr std::uint64_t kMiB = 1 << 20;
constexpr Level kLevels[] = {{250'000, 4 * kMiB, kMiB / 4, 10e6, 1e6},
                             {1'000'000, 16 * kMiB, kMiB, 25e6, 4e6},
                             {4'000'000, 64 * kMiB, 4 * kMiB, 100e6, 16e6},
                             {16'000'000, 256 * kMiB, 16 * kMiB, 400e6, 64e6}};

std::uint64_t bytes_of(const SegmentInfo& segment) {
  return segment.bytes + segment.sh_bytes;
}

// Clause 2.2: work of the tables of a record with its own layout.
std::uint64_t table_work(std::uint64_t record_bytes) {
  return kTableWork * std::min<std::uint64_t>(kMaxOwnTables, record_bytes / kTableBytes);
}

std::uint64_t work_of(const SegmentInfo& segment, bool own_layouts) {
  const std::uint64_t tables =
      own_layouts ? table_work(segment.bytes) + table_work(segment.sh_bytes) : 0;
  return std::max<std::uint64_t>(segment.primitives, kMinSegmentWork) + tables;
}

// The segments needed at a time that advances. Neighbours in the file form one range.
class ActiveSegments {
 public:
  explicit ActiveSegments(const std::vector<SegmentInfo>& segments)
      : segments_(segments), is_active_(segments.size() + 2) {}

  void add(std::uint32_t s) {
    ranges_ += 1 - is_active_[s] - is_active_[s + 2];
    is_active_[s + 1] = 1;
    ++count_;
    primitives_ += segments_[s].primitives;
    bytes_ += bytes_of(segments_[s]);
  }
  void remove(std::uint32_t s) {
    ranges_ -= 1 - is_active_[s] - is_active_[s + 2];
    is_active_[s + 1] = 0;
    --count_;
    primitives_ -= segments_[s].primitives;
    bytes_ -= bytes_of(segments_[s]);
  }
  void note(DecoderNeeds& needs) const {
    needs.primitives = std::max(needs.primitives, primitives_);
    needs.segments = std::max(needs.segments, count_);
    needs.bytes = std::max(needs.bytes, bytes_);
    needs.ranges = std::max(needs.ranges, static_cast<std::uint64_t>(ranges_));
  }

 private:
  const std::vector<SegmentInfo>& segments_;
  std::vector<std::uint8_t> is_active_;  // segment s is at s + 1
  std::uint64_t primitives_ = 0, count_ = 0, bytes_ = 0;
  std::int64_t ranges_ = 0;
};

std::vector<std::uint32_t> by_beginning(const std::vector<SegmentInfo>& segments) {
  std::vector<std::uint32_t> order;
  for (std::uint32_t s = 0; s < segments.size(); ++s) {
    if (segments[s].is_needed()) order.push_back(s);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return segments[a].begin_ticks < segments[b].begin_ticks;
  });
  return order;
}

// Clause 2.1. The number of segments can only increase where one begins. Those that end there are
// still needed at that time, unless their part is not displayed any more.
void sweep(const std::vector<SegmentInfo>& segments, const std::vector<std::uint32_t>& order,
           DecoderNeeds& needs) {
  using Ending = std::tuple<double, bool, std::uint32_t>;  // end, is needed at it, segment
  std::priority_queue<Ending, std::vector<Ending>, std::greater<>> endings;
  ActiveSegments active(segments);
  for (std::size_t i = 0; i < order.size();) {
    const double t = segments[order[i]].begin_ticks;
    while (!endings.empty()) {
      const auto [end, needed_at_end, segment] = endings.top();
      if (end > t || (end == t && needed_at_end)) break;
      active.remove(segment);
      endings.pop();
    }
    for (; i < order.size() && segments[order[i]].begin_ticks == t; ++i) {
      active.add(order[i]);
      const SegmentInfo& segment = segments[order[i]];
      endings.emplace(segment.end_ticks, segment.needed_at_end, order[i]);
    }
    active.note(needs);
  }
}

// Clause 2.2.
void add_rate(const SceneReader& reader, const std::vector<std::uint32_t>& order,
              DecoderNeeds& needs) {
  needs.startup_bytes = needs.index_bytes;
  double bits = 0, primitives = 0;
  for (const std::uint32_t s : order) {
    const SegmentInfo& segment = reader.segments()[s];
    const double seconds = reader.metadata().time_base.seconds(segment.begin_ticks);
    if (seconds <= 1.0) {
      needs.startup_bytes += bytes_of(segment);
      continue;
    }
    bits += 8.0 * static_cast<double>(bytes_of(segment));
    primitives += static_cast<double>(work_of(segment, !reader.has_layouts()));
    needs.bits_per_second = std::max(needs.bits_per_second, bits / seconds);
    needs.primitives_per_second = std::max(needs.primitives_per_second, primitives / seconds);
  }
}

}  // namespace

DecoderNeeds decoder_needs(const SceneReader& reader) {
  DecoderNeeds needs;
  needs.index_bytes = reader.head_bytes();
  const std::vector<std::uint32_t> order = by_beginning(reader.segments());
  sweep(reader.segments(), order, needs);
  add_rate(reader, order, needs);
  needs.decoded_bytes = needs.primitives * 4 * floats_per_primitive(reader.sh_degree());
  int number = 0;
  for (const Level& level : kLevels) {
    ++number;
    if (needs.primitives <= level.primitives && needs.bytes <= level.bytes &&
        needs.index_bytes <= level.index_bytes && needs.bits_per_second <= level.bits_per_second &&
        needs.primitives_per_second <= level.primitives_per_second) {
      needs.level = number;
      break;
    }
  }
  return needs;
}

}  // namespace stgs
