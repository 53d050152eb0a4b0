// SPDX-License-Identifier: Apache-2.0
#include "stream/segment_index.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "resident_segment.h"
#include "stream/no_memory.h"
#include "stream/tier_peaks.h"

namespace stgs::player {
namespace {

std::uint64_t offset_of(const SegmentInfo& segment, bool sh) {
  return sh ? segment.sh_offset : segment.offset;
}
std::uint64_t bytes_of(const SegmentInfo& segment, bool sh) {
  return sh ? segment.sh_bytes : segment.bytes;
}

// Returns the number of tiers of a file, at least `tiers`.
int tiers_of(const std::vector<SegmentInfo>& segments, int tiers) {
  for (const SegmentInfo& segment : segments) tiers = std::max(tiers, segment.tier + 1);
  return tiers;
}

// Returns the layers of the segments from index `first` on, ordered by offset.
std::vector<SegmentLayer> layers_from(const std::vector<SegmentInfo>& segments, std::size_t first) {
  std::vector<SegmentLayer> out;
  for (std::size_t s = first; s < segments.size(); ++s) {
    for (const bool sh : {false, true}) {
      if (bytes_of(segments[s], sh) == 0) continue;
      out.push_back({static_cast<std::uint32_t>(s), sh});
    }
  }
  const auto offset = [&](const SegmentLayer& layer) {
    return offset_of(segments[layer.segment], layer.sh);
  };
  std::sort(out.begin(), out.end(),
            [&](const SegmentLayer& a, const SegmentLayer& b) { return offset(a) < offset(b); });
  return out;
}

}  // namespace

std::uint64_t SegmentIndex::stored_bytes(const SegmentLayer& layer) const {
  return bytes_of(info(layer.segment), layer.sh);
}

std::uint64_t SegmentIndex::file_offset(const SegmentLayer& layer) const {
  return offset_of(info(layer.segment), layer.sh);
}

std::uint64_t SegmentIndex::memory_bytes(const SegmentLayer& layer) const {
  if (layer.sh) return stored_bytes(layer);
  return stored_bytes(layer) + overhead_ +
         decoded_segment_bytes(info(layer.segment).primitives, reader().sh_degree());
}

// Returns whether the segments of `reader` begin with the known ones.
bool SegmentIndex::is_continuation(const SceneReader& next) const {
  const std::vector<SegmentInfo>&before = reader().segments(), &now = next.segments();
  const auto same = [](const SegmentInfo& a, const SegmentInfo& b) {
    return a.offset == b.offset && a.bytes == b.bytes && a.primitives == b.primitives &&
           a.sh_offset == b.sh_offset && a.sh_bytes == b.sh_bytes;
  };
  return now.size() >= before.size() && std::equal(before.begin(), before.end(), now.begin(), same);
}

SegmentIndex::Update SegmentIndex::prepare(std::shared_ptr<const SceneReader> reader) {
  const std::vector<SegmentInfo>& segments = reader->segments();
  Update update;
  // Another recording may have taken the place of this one.
  update.renumbered = now_.reader != nullptr && !is_continuation(*reader);
  update.added = layers_from(segments, update.renumbered ? 0 : size());
  reserve_for(file_order_, (update.renumbered ? 0 : file_order_.size()) + update.added.size());
  reserve_for(file_index_, 2 * segments.size());
  if (now_.reader != nullptr && !update.renumbered) {
    update.ended = reader->ended_segments(now_.reader->end_records());
    std::erase_if(update.ended, [this](std::uint32_t segment) { return segment >= size(); });
  }
  update.tiers = tiers_of(segments, tiers_);
  if (max_primitives_) update.tier_peaks = player::tier_peaks(segments, update.tiers);
  update.reader = std::move(reader);
  return update;
}

void SegmentIndex::adopt(Update update) noexcept {
  if (update.renumbered) {
    file_order_.clear();
    file_index_.clear();
    ++now_.generation;
  }
  now_.reader = std::move(update.reader);
  ++revision_;
  tiers_ = update.tiers;
  tier_peaks_ = std::move(update.tier_peaks);
  choose_tiers();
  file_index_.resize(2 * size());
  const auto before = [this](const SegmentLayer& a, const SegmentLayer& b) {
    return file_offset(a) < file_offset(b);
  };
  std::size_t known = file_order_.size();
  file_order_.insert(file_order_.end(), update.added.begin(), update.added.end());
  // A recording only adds layers at its end.
  if (known > 0 && known < file_order_.size() &&
      before(file_order_[known], file_order_[known - 1])) {
    std::inplace_merge(file_order_.begin(),
                       file_order_.begin() + static_cast<std::ptrdiff_t>(known), file_order_.end(),
                       before);
    known = 0;
  }
  for (std::size_t i = known; i < file_order_.size(); ++i) {
    const SegmentLayer& layer = file_order_[i];
    file_index_[2 * std::size_t{layer.segment} + (layer.sh ? 1 : 0)] = i;
  }
}

void SegmentIndex::limit_primitives(std::uint64_t max_primitives) {
  if (tier_peaks_.empty() && size() > 0)
    tier_peaks_ = player::tier_peaks(reader().segments(), tiers_);
  max_primitives_ = max_primitives;
  ++revision_;
  choose_tiers();
}

void SegmentIndex::choose_tiers() noexcept {
  if (!max_primitives_) return;
  const auto end = std::upper_bound(tier_peaks_.begin(), tier_peaks_.end(), *max_primitives_);
  needed_tiers_ = std::max(1, static_cast<int>(end - tier_peaks_.begin()));
}

std::vector<TickRange> SegmentIndex::upcoming_times(const Playhead& playhead,
                                                    double seconds) const {
  constexpr double kAround = 1;  // ticks; callers check each layer exactly
  const double speed = std::abs(playhead.ticks_per_second);
  const double ahead = seconds * speed, at = playhead.ticks, end = playhead.duration;
  const bool back = playhead.ticks_per_second < 0;
  std::vector<TickRange> out = {back ? TickRange{at - ahead - kAround, at + kAround}
                                     : TickRange{at - kAround, at + ahead + kAround}};
  if (const double wrapped = back ? end + at - ahead : at + ahead - end; playhead.loop) {
    out.push_back(back ? TickRange{std::max(wrapped, at) - kAround, end}
                       : TickRange{0, std::min(wrapped, at) + kAround});
  }
  return out;
}

std::optional<TickRange> SegmentIndex::unknown_times(const Playhead& playhead,
                                                     double seconds) const {
  if (reader().unloaded().empty()) return {};
  const double at = playhead.ticks;
  if (!reader().is_loaded(at, at)) return TickRange{at, at};
  for (const TickRange& range : upcoming_times(playhead, seconds)) {
    if (range.begin <= range.end && !reader().is_loaded(range.begin, range.end)) return range;
  }
  return {};
}

std::vector<std::size_t> SegmentIndex::upcoming_layers(const Playhead& playhead,
                                                       double seconds) const {
  std::vector<std::uint32_t> near;
  for (const TickRange& range : upcoming_times(playhead, seconds)) {
    const auto more = reader().segments_between(range.begin, range.end);
    near.insert(near.end(), more.begin(), more.end());
  }
  std::vector<std::size_t> out;
  for (const std::uint32_t segment : near) {
    for (const bool sh : {false, true}) {
      if (stored_bytes({segment, sh}) > 0) out.push_back(file_index({segment, sh}));
    }
  }
  // In file order, so that ties go to the first. Removes those that are near in both directions.
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

}  // namespace stgs::player
