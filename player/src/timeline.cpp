// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/timeline.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "renderer_memory.h"
#include "resident_segment.h"
#include "stgs/format/parallel.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

struct Resident {
  ResidentSegment decoded;
  std::vector<std::uint32_t> candidates;  // at the last requested time
  std::uint64_t used = 0;                 // number of the call that used it last
};

class SegmentTimeline final : public Timeline {
 public:
  SegmentTimeline(std::unique_ptr<SceneReader> reader, std::uint64_t budget, std::string name,
                  DamagePolicy policy)
      : name_(std::move(name)),
        reader_(std::move(reader)),
        memory_budget_(budget),
        policy_(policy),
        budget_(make_budget(budget)),
        charge_(budget_->charge(Budget::Pool::kSegments, 0)) {
    number_primitives();
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
  const std::vector<SegmentDamage>& segment_damage() const override { return damage_; }
  std::uint64_t memory_bytes() const override { return bytes_; }
  std::uint64_t stored_primitives() const override { return primitives_; }

  const SceneReader& reader() const override { return *reader_; }
  std::uint64_t memory_budget() const override { return memory_budget_; }
  const std::shared_ptr<Budget>& budget() const override { return budget_; }
  const std::shared_ptr<const void>& identity() const override { return identity_; }

  Result<std::vector<SegmentRef>> visible_segments(double seconds) override {
    if (!std::isfinite(seconds)) {
      return usage_error("{}: a time must be a finite number of seconds, got {}", name_, seconds);
    }
    const double ticks = metadata().time_base.ticks(seconds);
    STGS_TRY(load_index(std::clamp(ticks, 0.0, static_cast<double>(metadata().frames))));
    auto all = reader_->segments_between(ticks, ticks);
    std::sort(all.begin(), all.end());
    std::vector<SegmentRef> refs;
    for (std::uint32_t s : all) {
      if (unusable_.count(s) != 0) continue;
      const ScenePart& part = reader_->parts()[reader_->segments()[s].part];
      const auto version = versions_.find(s);
      refs.push_back({s, ticks - part.begin_ticks, id_base_[s], nullptr,
                      version == versions_.end() ? 0 : version->second});
    }
    if (is_unlisted(ticks) && (refs.empty() || policy_ == DamagePolicy::kReject)) {
      return invalid_file(
          "no data for {:.6g} s can be read: the part of the index that lists it is damaged",
          seconds);
    }
    if (refs.empty() && !all.empty()) {
      const Status& reason = damage_[unusable_.at(all.front())].reason;
      return Status(reason.code(),
                    fmt::format("no data for {:.6g} s can be read: {}", seconds, reason.message()));
    }
    return refs;
  }

  Result<Active> at(double seconds) override {
    STGS_ASSIGN(std::vector<SegmentRef> refs, visible_segments(seconds));
    Active active;
    active.ticks = metadata().time_base.ticks(seconds);
    ++call_;
    try {
      STGS_TRY(make_resident(refs, seconds));
      STGS_ASSIGN(refs, visible_segments(seconds));
      std::vector<Resident*> resident;
      resident.reserve(refs.size());
      for (const SegmentRef& ref : refs) resident.push_back(&resident_.at(ref.segment));
      const auto ticks_in = [&](std::size_t i) {
        return refs[i].ticks - resident[i]->decoded.set.time_origin;
      };
      parallel_for(std::size_t{0}, resident.size(), [&](std::size_t i) {
        resident[i]->decoded.find_candidates(static_cast<float>(ticks_in(i)),
                                             resident[i]->candidates);
      });
      for (std::size_t i = 0; i < resident.size(); ++i) {
        if (resident[i]->candidates.empty()) continue;
        active.segments.push_back({refs[i].segment, &resident[i]->decoded.set,
                                   &resident[i]->candidates, ticks_in(i), refs[i].id_base});
      }
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("{}: cannot load the segments active at {} s: {}",
                                            name_, seconds, e.what()));
    }
    return active;
  }

  Result<std::optional<Gaussians4D>> decode(std::uint32_t segment) override {
    Status sh_status;
    Result<Gaussians4D> set = decode_intact(segment, sh_status);
    STGS_TRY(accept(segment, set.status(), sh_status));
    std::optional<Gaussians4D> out;
    if (set.ok()) out = std::move(set).value();
    return out;
  }

 private:
  // Reads the index as far as it concerns a time.
  Status load_index(double ticks) {
    if (reader_->is_loaded(ticks, ticks)) return {};
    std::vector<std::uint64_t> known = reader_->end_records();
    STGS_TRY(reader_->load(ticks, ticks));
    number_primitives();
    for (const std::uint32_t segment : reader_->ended_segments(std::move(known))) {
      ++versions_[segment];
      if (const auto found = resident_.find(segment); found != resident_.end()) evict(found);
    }
    return {};
  }

  // Numbers the primitives of segments that are new.
  void number_primitives() {
    const std::vector<SegmentInfo>& segments = reader_->segments();
    for (std::size_t s = id_base_.size(); s < segments.size(); ++s) {
      id_base_.push_back(s > 0 ? id_base_[s - 1] + segments[s - 1].primitives : 0);
    }
  }

  // Returns whether a damaged node of the index listed segments that may be active at `ticks`.
  bool is_unlisted(double ticks) const {
    const double at = std::clamp(ticks, 0.0, static_cast<double>(metadata().frames));
    const std::vector<LostFragment>& lost = reader_->lost_fragments();
    return std::any_of(lost.begin(), lost.end(), [at](const LostFragment& fragment) {
      return fragment.range.begin <= at && at <= fragment.range.end;
    });
  }

  std::uint64_t bytes_of(std::uint32_t segment) const {
    if (!reader_->segments()[segment].available) return 0;
    return decoded_segment_bytes(reader_->segments()[segment].primitives, reader_->sh_degree());
  }

  // Makes segments (ascending) resident and evicts others if the budget requires it. Segments that
  // turn out to be unusable are recorded as damaged instead.
  Status make_resident(const std::vector<SegmentRef>& refs, double seconds) {
    std::vector<std::uint32_t> missing;
    std::uint64_t total = 0, more = 0;
    for (const SegmentRef& ref : refs) {
      const std::uint32_t segment = ref.segment;
      total += bytes_of(segment);
      if (const auto found = resident_.find(segment); found != resident_.end()) {
        found->second.used = call_;
      } else {
        missing.push_back(segment);
        more += bytes_of(segment);
      }
    }
    if (total > memory_budget_) return over_budget_error(name_, seconds, total, memory_budget_);
    evict_for(more);
    charge_.resize(bytes_ + more);
    const Status status = decode(missing);
    charge_.resize(bytes_);
    return status;
  }

  // Evicts the least recently used segments until `bytes` more fit the budget.
  void evict_for(std::uint64_t bytes) {
    while (bytes_ + bytes > memory_budget_) {
      const auto oldest = std::min_element(
          resident_.begin(), resident_.end(),
          [](const auto& a, const auto& b) { return a.second.used < b.second.used; });
      evict(oldest);
    }
  }

  void evict(std::map<std::uint32_t, Resident>::iterator segment) {
    bytes_ -= bytes_of(segment->first);
    primitives_ -= segment->second.decoded.set.size();
    resident_.erase(segment);
  }

  // Decodes a segment according to the damage policy.
  Result<Gaussians4D> decode_intact(std::uint32_t segment, Status& sh_status) const {
    const TimeOrigin origin = reader_->render_origin(segment);
    return policy_ == DamagePolicy::kReject ? reader_->decode(segment, true, origin)
                                            : reader_->decode_intact(segment, sh_status, origin);
  }

  Status decode(const std::vector<std::uint32_t>& missing) {
    std::vector<std::optional<Resident>> fresh(missing.size());  // constructed in place
    std::vector<Status> results(missing.size()), sh_status(missing.size());
    parallel_for(std::size_t{0}, missing.size(), [&](std::size_t i) {
      auto set = decode_intact(missing[i], sh_status[i]);
      if (!set.ok()) {
        results[i] = set.status();
        return;
      }
      fresh[i].emplace(Resident{ResidentSegment(std::move(set).value()), {}, call_});
    });
    for (const Status& status : results) {
      if (!can_skip(status)) return status;
    }
    for (std::size_t i = 0; i < missing.size(); ++i) {
      record_damage(missing[i], results[i], sh_status[i]);
      if (!results[i].ok()) continue;
      bytes_ += bytes_of(missing[i]);
      primitives_ += fresh[i]->decoded.set.size();
      resident_.emplace(missing[i], std::move(*fresh[i]));
    }
    return {};
  }

  // Returns the error, or records it as damage if the policy skips it.
  Status accept(std::uint32_t segment, const Status& base, const Status& sh_status) {
    if (!can_skip(base)) return base;
    record_damage(segment, base, sh_status);
    return {};
  }

  // Returns whether the policy skips an error. Skips errors of the file only: a retry would fail
  // the same way.
  bool can_skip(const Status& status) const {
    return status.ok() || (policy_ == DamagePolicy::kSkip && is_damage(status.code()));
  }

  void record_damage(std::uint32_t segment, const Status& base, const Status& sh_status) {
    if (base.ok() && sh_status.ok()) return;
    if (base.ok() && !without_sh_.insert(segment).second) return;  // already recorded
    if (!base.ok()) unusable_.emplace(segment, damage_.size());
    damage_.push_back({segment, base.ok(), base.ok() ? sh_status : base});
  }

  std::string name_;
  std::shared_ptr<const void> identity_ = std::make_shared<char>();
  std::unique_ptr<SceneReader> reader_;
  std::uint64_t memory_budget_ = 0;
  DamagePolicy policy_ = DamagePolicy::kReject;
  std::vector<SegmentDamage> damage_;
  std::map<std::uint32_t, std::size_t>
      unusable_;                        // segments that are not rendered: index in damage_
  std::set<std::uint32_t> without_sh_;  // segments rendered without their spherical harmonics
  std::uint64_t bytes_ = 0, primitives_ = 0, call_ = 0;
  std::vector<std::uint32_t> id_base_;
  std::map<std::uint32_t, Resident> resident_;
  std::map<std::uint32_t, std::uint64_t> versions_;  // of segments with ends
  std::shared_ptr<Budget> budget_;
  Lease charge_;  // of `resident_` and of what is being decoded
};

}  // namespace

Result<std::unique_ptr<Timeline>> Timeline::open(const std::string& location,
                                                 std::uint64_t memory_budget, DamagePolicy policy) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_location(location));
  STGS_ASSIGN(auto reader,
              SceneReader::open(std::move(source), {}, std::pmr::get_default_resource(),
                                IndexLoading::kOnDemand));
  return from_reader(std::move(reader), location, memory_budget, policy);
}

std::unique_ptr<Timeline> Timeline::from_reader(std::unique_ptr<SceneReader> reader,
                                                const std::string& name,
                                                std::uint64_t memory_budget, DamagePolicy policy) {
  return std::make_unique<SegmentTimeline>(std::move(reader), memory_budget, name, policy);
}

}  // namespace stgs::player
