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

constexpr double kSoonSeconds = 0.5;  // of the viewer's time

class StreamTimeline final : public Timeline {
 public:
  StreamTimeline(SegmentStore& store, std::string name) : store_(store), name_(std::move(name)) {
    look_again();
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
  const std::vector<SegmentDamage>& segment_damage() const override { return losses_; }
  std::uint64_t memory_bytes() const override { return store_.statistics().memory_bytes; }
  std::uint64_t stored_primitives() const override { return store_.statistics().stored_primitives; }

  const SceneReader& reader() const override { return *known_.reader; }
  std::uint64_t memory_budget() const override { return store_.memory_budget(); }
  bool is_playing() const override { return !store_.motion().still; }
  const std::shared_ptr<const void>& identity() const override { return identity_; }

  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    STGS_ASSIGN(const std::vector<Drawn> drawn, held_at(seconds));
    std::vector<SegmentRef> needed;
    for (const Drawn& one : drawn) needed.push_back(needed_of(one));
    return needed;
  }

  std::vector<SegmentRef> prefetch_segments(double seconds) override {
    Playhead motion = store_.motion();
    if (motion.still || !std::isfinite(seconds)) return {};
    motion.ticks = std::clamp(metadata().time_base.ticks(seconds), 0.0, motion.duration);
    const std::vector<SegmentInfo>& segments = reader().segments();
    std::vector<std::tuple<double, int, std::uint32_t>> coming;  // seconds, tier, segment
    for (const std::uint32_t s : near(motion)) {
      const double in = need_of(segments[s].begin_ticks, segments[s].end_ticks, motion).from;
      if (in <= kSoonSeconds) coming.emplace_back(in, segments[s].tier, s);
    }
    std::sort(coming.begin(), coming.end());
    std::vector<SegmentRef> needed;
    for (const auto& [in, tier, segment] : coming) {
      auto held = store_.held(segment, known_.generation);
      if (held != nullptr) needed.push_back(needed_of({segment, std::move(held), 0, {}}));
    }
    return needed;
  }

  Result<std::optional<Gaussians4D>> decode(std::uint32_t segment) override {
    std::optional<Gaussians4D> out;
    if (const auto held = store_.held(segment, known_.generation)) out = held->set;
    return out;
  }

  Result<Active> at(double seconds) override {
    drawn_.clear();
    STGS_ASSIGN(drawn_, held_at(seconds));
    Active active;
    active.ticks = metadata().time_base.ticks(seconds);
    parallel_for(std::size_t{0}, drawn_.size(), [&](std::size_t i) {
      drawn_[i].held->find_candidates(static_cast<float>(drawn_[i].ticks), drawn_[i].candidates);
    });
    for (const Drawn& drawn : drawn_) {
      if (drawn.candidates.empty()) continue;
      active.segments.push_back({drawn.segment, &drawn.held->set, &drawn.candidates, drawn.ticks,
                                 id_base_[drawn.segment]});
    }
    return active;
  }

 private:
  // Kept until the next call, even if the store drops it.
  struct Drawn {
    std::uint32_t segment = 0;
    std::shared_ptr<const ResidentSegment> held;
    double ticks = 0;  // the moment in its part
    std::vector<std::uint32_t> candidates;
  };

  // Ascending: all that somebody who moves on may see soon, and more, but what he sees.
  std::vector<std::uint32_t> near(const Playhead& motion) const {
    const double at = motion.ticks, to = at + kSoonSeconds * motion.ticks_per_second;
    std::vector<std::uint32_t> near = reader().segments_between(std::min(at, to), std::max(at, to));
    if (motion.loop && (to < 0 || to > motion.duration)) {
      const double round = to < 0 ? to + motion.duration : to - motion.duration;
      const auto beyond = to < 0 ? reader().segments_between(round, motion.duration)
                                 : reader().segments_between(0, round);
      near.insert(near.end(), beyond.begin(), beyond.end());
    }
    std::sort(near.begin(), near.end());
    near.erase(std::unique(near.begin(), near.end()), near.end());
    std::vector<std::uint32_t> alive = reader().segments_between(at, at);
    std::sort(alive.begin(), alive.end());
    std::erase_if(
        near, [&](std::uint32_t s) { return std::binary_search(alive.begin(), alive.end(), s); });
    return near;
  }

  SegmentRef needed_of(const Drawn& one) const {
    return {one.segment, one.ticks, id_base_[one.segment],
            std::shared_ptr<const Gaussians4D>(one.held, &one.held->set)};
  }

  // What the file is now.
  void look_again() {
    SegmentStore::Known now = store_.known();
    if (now.reader == known_.reader) return;
    const bool anew = now.generation != known_.generation;
    const std::vector<SegmentInfo>& segments = now.reader->segments();
    // All that can throw comes before all that changes.
    reserve_for(id_base_, segments.size());
    if (anew) identity_ = std::make_shared<char>();
    if (anew) id_base_.clear();
    known_ = std::move(now);
    for (std::size_t s = id_base_.size(); s < segments.size(); ++s) {
      id_base_.push_back(s > 0 ? id_base_[s - 1] + segments[s - 1].primitives : 0);
    }
  }

  // What is there of the moment; all else as of now.
  Result<std::vector<Drawn>> held_at(double seconds) {
    if (!std::isfinite(seconds)) {
      return usage_error("{}: a moment must be a number of seconds, not {}", name_, seconds);
    }
    look_again();
    const double ticks = metadata().time_base.ticks(seconds);
    std::vector<std::uint32_t> alive = reader().segments_between(ticks, ticks);
    std::sort(alive.begin(), alive.end());
    losses_ = store_.segment_damage();
    std::vector<Drawn> drawn;
    for (const std::uint32_t segment : alive) {
      const SegmentInfo& info = reader().segments()[segment];
      const double begin = reader().parts()[info.part].begin_ticks;
      if (auto held = store_.held(segment, known_.generation)) {
        drawn.push_back({segment, std::move(held), ticks - begin, {}});
      }
    }
    return drawn;
  }

  SegmentStore& store_;
  std::string name_;
  SegmentStore::Known known_;  // as of the last time that something was asked for
  std::shared_ptr<const void> identity_ = std::make_shared<char>();
  std::vector<std::uint32_t> id_base_;
  std::vector<Drawn> drawn_;
  std::vector<SegmentDamage> losses_;
};

}  // namespace

std::unique_ptr<Timeline> make_stream_timeline(SegmentStore& store, std::string name) {
  return std::make_unique<StreamTimeline>(store, std::move(name));
}

}  // namespace stgs::player
