// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_timeline.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "stgs/format/parallel.h"
#include "stream/no_memory.h"

namespace stgs::player {
namespace {

constexpr double kPrefetchSeconds = 0.5;  // of playback

class StreamTimeline final : public Timeline {
 public:
  StreamTimeline(SegmentStore& store, std::string name) : store_(store), name_(std::move(name)) {
    update();
  }

  const std::string& name() const override { return name_; }
  const SceneMetadata& metadata() const override { return reader().metadata(); }
  double duration_seconds() const override {
    return metadata().time_base.seconds(metadata().frames);
  }
  const std::vector<Issue>& damage() const override { return reader().damage(); }
  double complete_seconds() const override {
    return metadata().time_base.seconds(reader().complete_ticks());
  }
  const std::vector<SegmentDamage>& segment_damage() const override { return damage_; }
  std::uint64_t memory_bytes() const override { return store_.statistics().memory_bytes; }
  std::uint64_t stored_primitives() const override { return store_.statistics().stored_primitives; }

  const SceneReader& reader() const override { return *snapshot_.reader; }
  std::uint64_t memory_budget() const override { return store_.memory_budget(); }
  const std::shared_ptr<Budget>& budget() const override { return store_.budget(); }
  bool is_playing() const override { return !store_.playhead().stationary; }
  const std::shared_ptr<const void>& identity() const override { return identity_; }

  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    STGS_ASSIGN(const std::vector<ActiveSegment> active, resident_at(seconds));
    std::vector<SegmentRef> refs;
    refs.reserve(active.size());
    for (const ActiveSegment& one : active) refs.push_back(ref_of(one));
    return refs;
  }

  std::vector<SegmentRef> prefetch_segments(double seconds) override {
    Playhead playhead = store_.playhead();
    if (playhead.stationary || !std::isfinite(seconds)) return {};
    playhead.ticks = std::clamp(metadata().time_base.ticks(seconds), 0.0, playhead.duration);
    const std::vector<SegmentInfo>& segments = reader().segments();
    std::vector<std::tuple<double, int, std::uint32_t>> upcoming;  // seconds, tier, segment
    for (const std::uint32_t s : near(playhead)) {
      const double in = need_of(segments[s].begin_ticks, segments[s].end_ticks, playhead).from;
      if (in <= kPrefetchSeconds) upcoming.emplace_back(in, segments[s].tier, s);
    }
    std::sort(upcoming.begin(), upcoming.end());
    std::vector<SegmentRef> refs;
    for (const auto& [in, tier, segment] : upcoming) {
      auto resident = store_.resident(segment, snapshot_.generation);
      if (resident != nullptr) refs.push_back(ref_of({segment, std::move(resident), 0, {}}));
    }
    return refs;
  }

  Result<std::optional<Gaussians4D>> decode(std::uint32_t segment) override {
    std::optional<Gaussians4D> out;
    if (const auto resident = store_.resident(segment, snapshot_.generation)) out = resident->set;
    return out;
  }

  Result<Active> at(double seconds) override {
    active_.clear();
    STGS_ASSIGN(active_, resident_at(seconds));
    Active active;
    active.ticks = metadata().time_base.ticks(seconds);
    const auto ticks_in = [](const ActiveSegment& one) {
      return one.ticks - one.resident->set.time_origin;
    };
    parallel_for(std::size_t{0}, active_.size(), [&](std::size_t i) {
      active_[i].resident->find_candidates(static_cast<float>(ticks_in(active_[i])),
                                           active_[i].candidates);
    });
    for (const ActiveSegment& one : active_) {
      if (one.candidates.empty()) continue;
      active.segments.push_back(
          {one.segment, &one.resident->set, &one.candidates, ticks_in(one), id_base_[one.segment]});
    }
    return active;
  }

 private:
  // Retained until the next call, even if the store evicts it.
  struct ActiveSegment {
    std::uint32_t segment = 0;
    std::shared_ptr<const ResidentSegment> resident;
    double ticks = 0;  // relative to the beginning of its part
    std::vector<std::uint32_t> candidates;
  };

  // Returns the segments within the prefetch window, ascending, except those active now.
  std::vector<std::uint32_t> near(const Playhead& playhead) const {
    const double at = playhead.ticks, to = at + kPrefetchSeconds * playhead.ticks_per_second;
    std::vector<std::uint32_t> near = reader().segments_between(std::min(at, to), std::max(at, to));
    if (playhead.loop && (to < 0 || to > playhead.duration)) {
      const double wrapped = to < 0 ? to + playhead.duration : to - playhead.duration;
      const auto beyond = to < 0 ? reader().segments_between(wrapped, playhead.duration)
                                 : reader().segments_between(0, wrapped);
      near.insert(near.end(), beyond.begin(), beyond.end());
    }
    std::sort(near.begin(), near.end());
    near.erase(std::unique(near.begin(), near.end()), near.end());
    std::vector<std::uint32_t> active = reader().segments_between(at, at);
    std::sort(active.begin(), active.end());
    std::erase_if(
        near, [&](std::uint32_t s) { return std::binary_search(active.begin(), active.end(), s); });
    return near;
  }

  SegmentRef ref_of(const ActiveSegment& one) const {
    return {one.segment, one.ticks, id_base_[one.segment],
            std::shared_ptr<const Gaussians4D>(one.resident, &one.resident->set)};
  }

  // Adopts the current snapshot of the file.
  void update() {
    FileSnapshot now = store_.snapshot();
    if (now.reader == snapshot_.reader) return;
    const bool renumbered = now.generation != snapshot_.generation;
    const std::vector<SegmentInfo>& segments = now.reader->segments();
    // Everything that can throw comes before any change.
    reserve_for(id_base_, segments.size());
    if (renumbered) identity_ = std::make_shared<char>();
    if (renumbered) id_base_.clear();
    snapshot_ = std::move(now);
    for (std::size_t s = id_base_.size(); s < segments.size(); ++s) {
      id_base_.push_back(s > 0 ? id_base_[s - 1] + segments[s - 1].primitives : 0);
    }
  }

  // Adopts the current state of the file and returns the resident segments at `seconds`.
  Result<std::vector<ActiveSegment>> resident_at(double seconds) {
    if (!std::isfinite(seconds)) {
      return usage_error("{}: a time must be a finite number of seconds, got {}", name_, seconds);
    }
    update();
    const double ticks = metadata().time_base.ticks(seconds);
    std::vector<std::uint32_t> active = reader().segments_between(ticks, ticks);
    std::sort(active.begin(), active.end());
    damage_ = store_.segment_damage();
    std::vector<ActiveSegment> out;
    for (const std::uint32_t segment : active) {
      const SegmentInfo& info = reader().segments()[segment];
      const double begin = reader().parts()[info.part].begin_ticks;
      if (auto resident = store_.resident(segment, snapshot_.generation)) {
        out.push_back({segment, std::move(resident), ticks - begin, {}});
      }
    }
    return out;
  }

  SegmentStore& store_;
  std::string name_;
  FileSnapshot snapshot_;  // as of the last update()
  std::shared_ptr<const void> identity_ = std::make_shared<char>();
  std::vector<std::uint32_t> id_base_;
  std::vector<ActiveSegment> active_;  // of the last at()
  std::vector<SegmentDamage> damage_;
};

}  // namespace

std::unique_ptr<Timeline> make_stream_timeline(SegmentStore& store, std::string name) {
  return std::make_unique<StreamTimeline>(store, std::move(name));
}

}  // namespace stgs::player
