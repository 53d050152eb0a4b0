// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_timeline.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "stgs/format/parallel.h"

namespace stgs::player {
namespace {

class StreamTimeline final : public Timeline {
 public:
  StreamTimeline(SegmentStore& store, std::string name) : store_(store), name_(std::move(name)) {
    std::uint32_t base = 0;
    for (const SegmentInfo& segment : store_.reader().segments()) {
      id_base_.push_back(base);
      base += segment.primitives;
    }
  }

  const std::string& name() const override { return name_; }
  const SceneMetadata& metadata() const override { return store_.reader().metadata(); }
  double duration_seconds() const override {
    return metadata().time_base.seconds(metadata().frames);
  }
  const std::vector<Issue>& damage() const override { return store_.reader().damage(); }
  double complete_seconds() const override {
    return metadata().time_base.seconds(store_.reader().complete_ticks());
  }
  const std::vector<Loss>& losses() const override { return losses_; }
  std::uint64_t memory_bytes() const override { return store_.statistics().memory_bytes; }
  std::uint64_t stored_primitives() const override { return store_.statistics().stored_primitives; }

  Result<Active> at(double seconds) override {
    if (!std::isfinite(seconds)) {
      return usage_error("{}: a moment must be a number of seconds, not {}", name_, seconds);
    }
    Active active;
    active.ticks = metadata().time_base.ticks(seconds);
    std::vector<std::uint32_t> alive = store_.reader().segments_between(active.ticks, active.ticks);
    std::sort(alive.begin(), alive.end());
    drawn_.clear();
    losses_ = store_.losses();
    for (const std::uint32_t segment : alive) {
      if (auto held = store_.held(segment)) drawn_.push_back({segment, std::move(held), {}});
    }
    parallel_for(std::size_t{0}, drawn_.size(), [&](std::size_t i) {
      drawn_[i].held->find_candidates(static_cast<float>(ticks_in_part(drawn_[i], active.ticks)),
                                      drawn_[i].candidates);
    });
    for (const Drawn& drawn : drawn_) {
      if (drawn.candidates.empty()) continue;
      active.parts.push_back({drawn.segment, &drawn.held->set, &drawn.candidates,
                              ticks_in_part(drawn, active.ticks), id_base_[drawn.segment]});
    }
    return active;
  }

 private:
  // Kept until the next call, even if the store drops it.
  struct Drawn {
    std::uint32_t segment = 0;
    std::shared_ptr<const HeldSegment> held;
    std::vector<std::uint32_t> candidates;
  };

  double ticks_in_part(const Drawn& drawn, double ticks) const {
    const SegmentInfo& segment = store_.reader().segments()[drawn.segment];
    return ticks - store_.reader().parts()[segment.part].begin_ticks;
  }

  SegmentStore& store_;
  std::string name_;
  std::vector<std::uint32_t> id_base_;
  std::vector<Drawn> drawn_;
  std::vector<Loss> losses_;
};

}  // namespace

std::unique_ptr<Timeline> make_stream_timeline(SegmentStore& store, std::string name) {
  return std::make_unique<StreamTimeline>(store, std::move(name));
}

}  // namespace stgs::player
