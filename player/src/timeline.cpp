// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/timeline.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "resident_segment.h"
#include "stgs/format/parallel.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

struct Held {
  ResidentSegment decoded;
  std::vector<std::uint32_t> candidates;  // at the moment asked for last
  std::uint64_t used = 0;                 // number of the call that needed it last
};

class SegmentTimeline final : public Timeline {
 public:
  SegmentTimeline(std::unique_ptr<SceneReader> reader, std::uint64_t budget, std::string name,
                  DamagePolicy damaged)
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
  const std::vector<SegmentDamage>& segment_damage() const override { return losses_; }
  std::uint64_t memory_bytes() const override { return bytes_; }
  std::uint64_t stored_primitives() const override { return primitives_; }

  const SceneReader& reader() const override { return *reader_; }
  std::uint64_t memory_budget() const override { return budget_; }
  const std::shared_ptr<const void>& identity() const override { return identity_; }

  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    if (!std::isfinite(seconds)) {
      return usage_error("{}: a moment must be a number of seconds, not {}", name_, seconds);
    }
    const double ticks = metadata().time_base.ticks(seconds);
    auto all = reader_->segments_between(ticks, ticks);
    std::sort(all.begin(), all.end());
    std::vector<SegmentRef> needed;
    for (std::uint32_t s : all) {
      if (lost_.count(s) != 0) continue;
      const ScenePart& part = reader_->parts()[reader_->segments()[s].part];
      needed.push_back({s, ticks - part.begin_ticks, id_base_[s], nullptr});
    }
    if (is_lost(ticks) && (needed.empty() || damaged_ == DamagePolicy::kReject)) {
      return invalid_file(
          "nothing of what is alive at {:.6g} s can be read: the fragment of the index that lists "
          "it is damaged",
          seconds);
    }
    if (needed.empty() && !all.empty()) {
      const Status& reason = losses_[lost_.at(all.front())].reason;
      return Status(reason.code(),
                    fmt::format("nothing of what is alive at {:.6g} s can be read: {}", seconds,
                                reason.message()));
    }
    return needed;
  }

  Result<Active> at(double seconds) override {
    STGS_ASSIGN(std::vector<SegmentRef> needed, visible_segments(seconds));
    Active active;
    active.ticks = metadata().time_base.ticks(seconds);
    ++call_;
    try {
      STGS_TRY(hold(needed, seconds));
      STGS_ASSIGN(needed, visible_segments(seconds));
      std::vector<Held*> held;
      for (const SegmentRef& one : needed) held.push_back(&held_.at(one.segment));
      parallel_for(std::size_t{0}, held.size(), [&](std::size_t i) {
        held[i]->decoded.find_candidates(static_cast<float>(needed[i].ticks), held[i]->candidates);
      });
      for (std::size_t i = 0; i < held.size(); ++i) {
        if (held[i]->candidates.empty()) continue;
        active.segments.push_back({needed[i].segment, &held[i]->decoded.set, &held[i]->candidates,
                                   needed[i].ticks, needed[i].id_base});
      }
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("{}: cannot hold what is alive at {} s: {}", name_,
                                            seconds, e.what()));
    }
    return active;
  }

  Result<std::optional<Gaussians4D>> decode(std::uint32_t segment) override {
    Status harmonics;
    Result<Gaussians4D> set = decode_intact(segment, harmonics);
    STGS_TRY(accept(segment, set.status(), harmonics));
    std::optional<Gaussians4D> out;
    if (set.ok()) out = std::move(set).value();
    return out;
  }

 private:
  // Whether a damaged fragment of the index listed what is first seen around this moment.
  bool is_lost(double ticks) const {
    const double frames = metadata().frames, at = std::clamp(ticks, 0.0, frames);
    const std::vector<LostFragment>& lost = reader_->lost_fragments();
    return std::any_of(lost.begin(), lost.end(), [at, frames](const LostFragment& stretch) {
      const auto [begin, end] = stretch.range;
      return begin <= at && (at < end || (begin < end && end >= frames));
    });
  }

  std::uint64_t bytes_of(std::uint32_t segment) const {
    if (!reader_->segments()[segment].available) return 0;
    return decoded_segment_bytes(reader_->segments()[segment].primitives, reader_->sh_degree());
  }

  // Makes the segments (ascending) present, and drops others where the budget asks for it; some of
  // them may be lost instead.
  Status hold(const std::vector<SegmentRef>& needed, double seconds) {
    std::vector<std::uint32_t> missing;
    std::uint64_t together = 0, more = 0;
    for (const SegmentRef& one : needed) {
      const std::uint32_t segment = one.segment;
      together += bytes_of(segment);
      if (const auto found = held_.find(segment); found != held_.end()) {
        found->second.used = call_;
      } else {
        missing.push_back(segment);
        more += bytes_of(segment);
      }
    }
    if (together > budget_) {
      return over_budget(name_, seconds, together, budget_);
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
      primitives_ -= oldest->second.decoded.set.size();
      held_.erase(oldest);
    }
  }

  // As the caller wants damage to be dealt with.
  Result<Gaussians4D> decode_intact(std::uint32_t segment, Status& harmonics) const {
    return damaged_ == DamagePolicy::kReject ? reader_->decode(segment)
                                             : reader_->decode_intact(segment, harmonics);
  }

  Status decode(const std::vector<std::uint32_t>& missing) {
    std::vector<std::optional<Held>> fresh(missing.size());  // made in place: in their memory
    std::vector<Status> results(missing.size()), harmonics(missing.size());
    parallel_for(std::size_t{0}, missing.size(), [&](std::size_t i) {
      auto set = decode_intact(missing[i], harmonics[i]);
      if (!set.ok()) {
        results[i] = set.status();
        return;
      }
      fresh[i].emplace(Held{ResidentSegment(std::move(set).value()), {}, call_});
    });
    for (const Status& status : results) {
      if (!can_pass_over(status)) return status;
    }
    for (std::size_t i = 0; i < missing.size(); ++i) {
      note_loss(missing[i], results[i], harmonics[i]);
      if (!results[i].ok()) continue;
      bytes_ += bytes_of(missing[i]);
      primitives_ += fresh[i]->decoded.set.size();
      held_.emplace(missing[i], std::move(*fresh[i]));
    }
    return {};
  }

  // The error, or where it can be passed over a note of it.
  Status accept(std::uint32_t segment, const Status& base, const Status& harmonics) {
    if (!can_pass_over(base)) return base;
    note_loss(segment, base, harmonics);
    return {};
  }

  // What the file is to blame for; another try would find the same.
  bool can_pass_over(const Status& status) const {
    return status.ok() ||
           (damaged_ == DamagePolicy::kSkip && (status.code() == StatusCode::kInvalidFile ||
                                                status.code() == StatusCode::kUnsupported));
  }

  void note_loss(std::uint32_t segment, const Status& base, const Status& harmonics) {
    if (base.ok() && harmonics.ok()) return;
    if (base.ok() && !plain_.insert(segment).second) return;  // decoded again
    if (!base.ok()) lost_.emplace(segment, losses_.size());
    losses_.push_back({segment, base.ok(), base.ok() ? harmonics : base});
  }

  std::string name_;
  std::shared_ptr<const void> identity_ = std::make_shared<char>();
  std::unique_ptr<SceneReader> reader_;
  std::uint64_t budget_ = 0;
  DamagePolicy damaged_ = DamagePolicy::kReject;
  std::vector<SegmentDamage> losses_;
  std::map<std::uint32_t, std::size_t> lost_;  // segments of which nothing is drawn: their losses
  std::set<std::uint32_t> plain_;              // those drawn without their harmonics
  std::uint64_t bytes_ = 0, primitives_ = 0, call_ = 0;
  std::vector<std::uint32_t> id_base_;
  std::map<std::uint32_t, Held> held_;
};

}  // namespace

Result<std::unique_ptr<Timeline>> Timeline::open(const std::string& place,
                                                 std::uint64_t memory_budget,
                                                 DamagePolicy damaged) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_location(place));
  STGS_ASSIGN(auto reader, SceneReader::open(std::move(source)));
  return from_reader(std::move(reader), place, memory_budget, damaged);
}

std::unique_ptr<Timeline> Timeline::from_reader(std::unique_ptr<SceneReader> reader,
                                                const std::string& name,
                                                std::uint64_t memory_budget, DamagePolicy damaged) {
  return std::make_unique<SegmentTimeline>(std::move(reader), memory_budget, name, damaged);
}

}  // namespace stgs::player
