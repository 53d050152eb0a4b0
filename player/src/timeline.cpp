// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/timeline.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

constexpr double kMiB = 1 << 20;

// A decoded segment with the support of each primitive, [begin, end] in ticks of its part. Scanning
// all supports of the segments alive is proportional to what is alive: a lifespan segment holds
// only primitives that live for a good part of its span.
struct Held {
  Gaussians4D set;
  std::vector<float> begin, end;
  std::vector<std::uint32_t> candidates;  // at the moment asked for last
  std::uint64_t used = 0;                 // number of the call that needed it last
};

// Bytes that a segment of n primitives takes once decoded, its candidates included.
std::uint64_t held_bytes(std::uint64_t n, int sh_degree) {
  const auto coefficients = static_cast<std::uint64_t>((sh_degree + 1) * (sh_degree + 1));
  const std::uint64_t floats = 3 + 3 + 4 + 1 + 3 * coefficients + 1 + 3 + 1 + 1;
  return n * (floats * sizeof(float) + 2 * sizeof(float) + sizeof(std::uint32_t));
}

// Widens by what float arithmetic can lose, so that the slice, not the timeline, decides on the
// last bit. Empty supports become begin > end.
void compute_supports(Held& held) {
  const Gaussians4D& set = held.set;
  held.begin.resize(set.size());
  held.end.resize(set.size());
  for (std::size_t i = 0; i < set.size(); ++i) {
    const float opacity = math::opacity_of(set.opacity_logit[i]);
    const float slack = 1e-5f * math::kAlphaThreshold;
    const float half = math::support_half_width(opacity + slack, set.sigma[i], set.radius[i],
                                                math::kAlphaThreshold);
    const float margin = 1e-5f * (std::abs(set.time[i]) + std::abs(half)) + 1e-5f;
    held.begin[i] = half < 0 ? std::numeric_limits<float>::max() : set.time[i] - half - margin;
    held.end[i] = half < 0 ? std::numeric_limits<float>::lowest() : set.time[i] + half + margin;
  }
}

void find_candidates(Held& held, float ticks) {
  held.candidates.resize(held.begin.size());
  std::size_t n = 0;
  for (std::size_t i = 0; i < held.begin.size(); ++i) {
    held.candidates[n] = static_cast<std::uint32_t>(i);
    n += static_cast<std::size_t>((held.begin[i] <= ticks) & (ticks <= held.end[i]));
  }
  held.candidates.resize(n);
}

class SegmentTimeline final : public Timeline {
 public:
  SegmentTimeline(std::unique_ptr<SceneReader> reader, std::uint64_t budget, std::string name,
                  Damaged damaged)
      : name_(std::move(name)), reader_(std::move(reader)), budget_(budget), damaged_(damaged) {
    std::uint32_t base = 0;
    for (const SegmentInfo& segment : reader_->segments()) {
      id_base_.push_back(base);
      base += segment.primitives;
    }
  }

  const std::string& name() const override { return name_; }
  const SceneMetadata& metadata() const override { return reader_->metadata(); }
  double duration_seconds() const override {
    return metadata().time_base.seconds(metadata().frames);
  }
  const std::vector<Issue>& damage() const override { return reader_->damage(); }
  double complete_seconds() const override {
    return metadata().time_base.seconds(reader_->complete_ticks());
  }
  const std::vector<Loss>& losses() const override { return losses_; }
  std::uint64_t memory_bytes() const override { return bytes_; }
  std::uint64_t stored_primitives() const override { return primitives_; }

  Result<Active> at(double seconds) override {
    if (!std::isfinite(seconds)) {
      return usage_error("{}: a moment must be a number of seconds, not {}", name_, seconds);
    }
    Active active;
    active.ticks = metadata().time_base.ticks(seconds);
    auto needed = reader_->segments_between(active.ticks, active.ticks);
    std::sort(needed.begin(), needed.end());
    ++call_;
    try {
      STGS_TRY(hold(without_lost(needed), seconds));
      const std::vector<std::uint32_t> all = std::exchange(needed, without_lost(needed));
      if (needed.empty() && !all.empty()) {
        const Status& reason = losses_[lost_.at(all.front())].reason;
        return Status(reason.code(),
                      fmt::format("nothing of what is alive at {:.6g} s can be read: "
                                  "{}",
                                  seconds, reason.message()));
      }
      std::vector<Held*> held;
      for (std::uint32_t segment : needed) held.push_back(&held_.at(segment));
      const auto moment_in = [&](std::size_t i) {
        const SegmentInfo& segment = reader_->segments()[needed[i]];
        return active.ticks - reader_->parts()[segment.part].begin_ticks;
      };
      parallel_for(std::size_t{0}, held.size(), [&](std::size_t i) {
        find_candidates(*held[i], static_cast<float>(moment_in(i)));
      });
      for (std::size_t i = 0; i < held.size(); ++i) {
        if (held[i]->candidates.empty()) continue;
        active.parts.push_back(
            {needed[i], &held[i]->set, &held[i]->candidates, moment_in(i), id_base_[needed[i]]});
      }
    } catch (const std::exception& e) {
      return runtime_error("{}: cannot hold what is alive at {} s: {}", name_, seconds, e.what());
    }
    return active;
  }

 private:
  std::uint64_t bytes_of(std::uint32_t segment) const {
    if (!reader_->segments()[segment].there) return 0;
    return held_bytes(reader_->segments()[segment].primitives, reader_->sh_degree());
  }

  std::vector<std::uint32_t> without_lost(std::vector<std::uint32_t> segments) const {
    const auto is_lost = [this](std::uint32_t s) { return lost_.count(s) != 0; };
    segments.erase(std::remove_if(segments.begin(), segments.end(), is_lost), segments.end());
    return segments;
  }

  // Makes the segments (ascending) present, and drops others where the budget asks for it; some of
  // them may be lost instead.
  Status hold(const std::vector<std::uint32_t>& needed, double seconds) {
    std::vector<std::uint32_t> missing;
    std::uint64_t together = 0, more = 0;
    for (std::uint32_t segment : needed) {
      together += bytes_of(segment);
      if (const auto found = held_.find(segment); found != held_.end()) {
        found->second.used = call_;
      } else {
        missing.push_back(segment);
        more += bytes_of(segment);
      }
    }
    if (together > budget_) {
      return runtime_error(
          "{}: the segments alive at {} s take {:.1f} MiB decoded, more than the budget of "
          "{:.1f} MiB; allow more memory",
          name_, seconds, static_cast<double>(together) / kMiB,
          static_cast<double>(budget_) / kMiB);
    }
    make_room(more);
    return decode(missing);
  }

  void make_room(std::uint64_t more) {
    while (bytes_ + more > budget_) {
      const auto oldest = std::min_element(
          held_.begin(), held_.end(),
          [](const auto& a, const auto& b) { return a.second.used < b.second.used; });
      bytes_ -= bytes_of(oldest->first);
      primitives_ -= oldest->second.set.size();
      held_.erase(oldest);
    }
  }

  Status decode(const std::vector<std::uint32_t>& missing) {
    std::vector<Held> fresh(missing.size());
    std::vector<Status> results(missing.size()), harmonics(missing.size());
    parallel_for(std::size_t{0}, missing.size(), [&](std::size_t i) {
      auto set = damaged_ == Damaged::kRefuse ? reader_->decode(missing[i])
                                              : reader_->decode_sound(missing[i], harmonics[i]);
      if (!set.ok()) {
        results[i] = set.status();
        return;
      }
      fresh[i].set = std::move(set).value();
      compute_supports(fresh[i]);
    });
    for (const Status& status : results) {
      if (!can_pass_over(status)) return status;
    }
    for (std::size_t i = 0; i < missing.size(); ++i) {
      note_loss(missing[i], results[i], harmonics[i]);
      if (!results[i].ok()) continue;
      fresh[i].used = call_;
      bytes_ += bytes_of(missing[i]);
      primitives_ += fresh[i].set.size();
      held_.emplace(missing[i], std::move(fresh[i]));
    }
    return {};
  }

  // What the file is to blame for; another try would find the same.
  bool can_pass_over(const Status& status) const {
    return status.ok() ||
           (damaged_ == Damaged::kPassOver && (status.code() == StatusCode::kInvalidFile ||
                                               status.code() == StatusCode::kUnsupported));
  }

  void note_loss(std::uint32_t segment, const Status& base, const Status& harmonics) {
    if (base.ok() && harmonics.ok()) return;
    if (base.ok() && !plain_.insert(segment).second) return;  // decoded again
    if (!base.ok()) lost_.emplace(segment, losses_.size());
    losses_.push_back({segment, base.ok(), base.ok() ? harmonics : base});
  }

  std::string name_;
  std::unique_ptr<SceneReader> reader_;
  std::uint64_t budget_ = 0;
  Damaged damaged_ = Damaged::kRefuse;
  std::vector<Loss> losses_;
  std::map<std::uint32_t, std::size_t> lost_;  // segments of which nothing is drawn: their losses
  std::set<std::uint32_t> plain_;              // those drawn without their harmonics
  std::uint64_t bytes_ = 0, primitives_ = 0, call_ = 0;
  std::vector<std::uint32_t> id_base_;
  std::map<std::uint32_t, Held> held_;
};

}  // namespace

Result<std::unique_ptr<Timeline>> Timeline::open(const std::string& place,
                                                 std::uint64_t memory_budget, Damaged damaged) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_place(place));
  STGS_ASSIGN(auto reader, SceneReader::open(std::move(source)));
  return over(std::move(reader), place, memory_budget, damaged);
}

std::unique_ptr<Timeline> Timeline::over(std::unique_ptr<SceneReader> reader,
                                         const std::string& name, std::uint64_t memory_budget,
                                         Damaged damaged) {
  return std::make_unique<SegmentTimeline>(std::move(reader), memory_budget, name, damaged);
}

}  // namespace stgs::player
