// SPDX-License-Identifier: Apache-2.0
#include "device_segments.h"

#include <algorithm>
#include <optional>

namespace stgs::player {
namespace {

constexpr double kMiB = 1 << 20;
// Primitives that are decoded at once, about: their floats are held beside what is drawn from.
constexpr std::uint64_t kBatch = 1 << 19;

}  // namespace

Result<std::vector<Timeline::Needed>> DeviceSegments::hold(Timeline& timeline, double seconds) {
  STGS_ASSIGN(std::vector<Timeline::Needed> needed, timeline.needed_at(seconds));
  STGS_TRY(change_to(timeline));
  STGS_TRY(make_present(timeline, needed, seconds));
  // Some may have turned out to be lost. Others may have come meanwhile: they are for next time.
  STGS_ASSIGN(needed, timeline.needed_at(seconds));
  std::erase_if(needed,
                [this](const Timeline::Needed& one) { return !held_.contains(one.segment); });
  return needed;
}

void DeviceSegments::keep(std::uint32_t segment, std::uint64_t primitives, std::uint64_t bytes) {
  held_.insert_or_assign(segment, Held{bytes, primitives, call_, {}});
  bytes_ += bytes;
  primitives_ += primitives;
}

Status DeviceSegments::decode_here(Timeline& timeline, std::uint32_t segment) {
  STGS_ASSIGN(const std::optional<Gaussians4D> set, timeline.decode(segment));
  return set ? send(segment, *set) : Status();
}

void DeviceSegments::clear() {
  while (!held_.empty()) drop(held_.begin());
}

void DeviceSegments::drop(Segments::iterator segment) {
  bytes_ -= segment->second.bytes;
  primitives_ -= segment->second.primitives;
  release(segment->first);
  held_.erase(segment);
}

bool DeviceSegments::has(const Timeline::Needed& needed) {
  const auto found = held_.find(needed.segment);
  if (found == held_.end()) return false;
  const auto& set = found->second.set;
  const bool same = !set.owner_before(needed.set) && !needed.set.owner_before(set);
  if (same) {
    found->second.used = call_;
  } else {
    drop(found);
  }
  return same;
}

Status DeviceSegments::change_to(const Timeline& timeline) {
  const auto known = timeline_.lock();
  if (known != nullptr && known == timeline.identity()) return {};
  clear();
  timeline_.reset();
  sh_degree_ = timeline.reader().sh_degree();
  STGS_TRY(begin(timeline.reader()));
  timeline_ = timeline.identity();
  return {};
}

Status DeviceSegments::make_present(Timeline& timeline, std::span<const Timeline::Needed> needed,
                                    double seconds) {
  ++call_;
  const auto& segments = timeline.reader().segments();
  std::vector<std::uint32_t> missing;
  std::vector<const Timeline::Needed*> decoded;
  std::uint64_t together = 0, more = 0;
  for (const Timeline::Needed& one : needed) {
    const SegmentInfo& info = segments[one.segment];
    const std::uint64_t bytes = info.there ? bytes_of(info.primitives) : 0;
    together += bytes;
    if (has(one)) continue;
    more += bytes;
    if (one.set == nullptr) {
      missing.push_back(one.segment);
    } else {
      decoded.push_back(&one);
    }
  }
  if (together > timeline.memory_budget()) {
    return runtime_error(
        "{}: the segments alive at {} s take {:.1f} MiB decoded, more than the budget of "
        "{:.1f} MiB; allow more memory",
        timeline.name(), seconds, static_cast<double>(together) / kMiB,
        static_cast<double>(timeline.memory_budget()) / kMiB);
  }
  while (!held_.empty() && bytes_ + more > timeline.memory_budget()) {
    drop(std::min_element(held_.begin(), held_.end(), [](const auto& a, const auto& b) {
      return a.second.used < b.second.used;
    }));
  }
  for (const Timeline::Needed* one : decoded) {
    STGS_TRY(send(one->segment, *one->set));
    held_.at(one->segment).set = one->set;
  }
  return decode_all(timeline, missing);
}

Status DeviceSegments::decode_all(Timeline& timeline, std::span<const std::uint32_t> segments) {
  const std::vector<SegmentInfo>& infos = timeline.reader().segments();
  for (std::size_t first = 0, end = 0; first < segments.size(); first = end) {
    std::uint64_t primitives = 0;
    while (end < segments.size() && (end == first || primitives < kBatch)) {
      primitives += infos[segments[end++]].primitives;
    }
    STGS_TRY(decode(timeline, segments.subspan(first, end - first)));
  }
  return {};
}

}  // namespace stgs::player
