// SPDX-License-Identifier: Apache-2.0
#include "train/scene_changes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "stgs/format/parallel.h"
#include "train/changed_points.h"
#include "train/persistence.h"
#include "train/ray_probe.h"
#include "train/set_views.h"

namespace stgs::encoder {
namespace {

// A primitive may have ended if it differs from the images in this part of the views that see it;
// above the second, it is likely.
constexpr double kMinChanged = 0.4, kLikelyChanged = 0.7;
// Side of a cell, over the radius of the scene. Primitives in adjacent cells end together.
constexpr double kCellShare = 0.04;
// The likely primitives of a group are seen at least so many times, over all views. A sample of
// these pixels is probed for depth. Beyond the slack, the depth is behind the group or before it.
// If this part of the depths is determined, and several times as many are behind the group as
// before it, the group has ended.
constexpr int kMinViews = 12;
constexpr std::size_t kMaxProbes = 200;
constexpr float kSideSlack = 0.05f;
constexpr double kMinDetermined = 0.25;
constexpr int kMinBehindFactor = 3;
// If fewer are determined: the group has ended if at least this part of the pixels matches without
// it, and the number of those that match worse without it is at most this part of the former.
constexpr double kMinUncovered = 0.12, kMaxWorse = 1.0 / 3;
constexpr float kMuchLess = 0.5f;  // an excess over another
// A primitive remains if more than this part of the views that differ is worse without it.
constexpr double kMaxWorseSingle = 0.25;
// A group has changed in a frame in which this part of its views differs.
constexpr double kMinChangedShare = 0.5;
// Primitives up to this part of the depth behind the visible surface are part of it.
constexpr float kDepthSlack = 0.03f;
constexpr float kMinKnownAlpha = 0.8f;  // of known content

// A view that sees a primitive.
struct Sight {
  std::uint32_t view, pixel;
};

// Numbers of views.
struct Tally {
  int seen = 0, changed = 0;
  int better = 0, worse = 0;  // without the primitives that may have ended

  Tally& operator+=(const Tally& other) {
    seen += other.seen;
    changed += other.changed;
    better += other.better;
    worse += other.worse;
    return *this;
  }
  double changed_share() const { return seen == 0 ? 0 : static_cast<double>(changed) / seen; }
};

// Counts the views in which a primitive differs.
Tally count(const std::vector<Sight>& sights, const std::vector<ViewChange>& changed) {
  Tally out;
  for (const auto& [view, pixel] : sights) {
    if (!changed[view].known()) continue;
    ++out.seen;
    out.changed += changed[view].has_changed(pixel) ? 1 : 0;
  }
  return out;
}

// Returns whether a pixel has changed in b, and not or much less in a.
bool is_better(const ViewChange& a, const ViewChange& b, std::size_t pixel) {
  return b.has_changed(pixel) &&
         (!a.has_changed(pixel) || a.excess[pixel] < kMuchLess * b.excess[pixel]);
}

bool is_uncovered(const Tally& likely) {
  return likely.better >= kMinUncovered * likely.seen && likely.worse <= kMaxWorse * likely.better;
}

class ChangeFinder {
 public:
  ChangeFinder(const PreparedCapture& capture, const TrainState& state,
               const std::vector<Residual>& residuals, int kernel)
      : capture_(capture), state_(state), views_(capture, state, kernel), residuals_(residuals) {
    for (std::size_t i = 0; i < state.size(); ++i)
      if (is_persistent(state, i)) members_.push_back(static_cast<std::uint32_t>(i));
    sights_.resize(members_.size());
    tallies_.resize(members_.size());
  }

  Result<SceneChanges> find(std::size_t max_points) {
    SceneChanges out;
    if (members_.empty()) return out;
    // Images of another size differ in other places.
    if (!fits_views()) residuals_.clear();
    const int last = capture_.frames - 1;
    STGS_ASSIGN(const std::vector<Image> images, views_.images(last));
    std::vector<SetView> shown = views_.render(state_.set.gather(members_));
    if (residuals_.empty()) {
      STGS_ASSIGN(const std::vector<Image> first, views_.images(0));
      update_residuals(shown, first, residuals_);
    }
    std::vector<ViewChange> changed = find_view_changes(shown, images, residuals_);
    find_suspects(shown, changed);
    std::vector<Group> groups = list_groups();
    if (!groups.empty()) {
      const std::vector<SetView> behind = views_.render(state_.set.gather(without(groups)));
      tally_without(changed, find_view_changes(behind, images, residuals_), behind);
      keep_ended(groups, RayProbe(views_, images, shown), changed);
    }
    if (!groups.empty()) {
      STGS_TRY(find_ends(groups, shown, out));
      shown = views_.render(state_.set.gather(without(groups)));
      changed = find_view_changes(shown, images, residuals_);
    }
    if (out.settled != kUnsettled) {
      STGS_ASSIGN(out.points, find_changed_points(views_, shown, images, changed, out.settled, last,
                                                  max_points));
    }
    update_residuals(shown, images, residuals_);
    out.residuals = std::move(residuals_);
    return out;
  }

 private:
  using Group = std::vector<std::size_t>;  // indices into members_
  using Cell = std::array<int, 3>;

  // Returns whether the residuals, if there are any, have the sizes of the views.
  bool fits_views() const {
    if (residuals_.empty()) return true;
    if (residuals_.size() != views_.size()) return false;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      const math::PinholeCamera& camera = views_.camera(v);
      const auto pixels =
          static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
      if (!residuals_[v].empty() && residuals_[v].size() != pixels) return false;
    }
    return true;
  }

  math::Vec3 position_of(std::size_t k) const {
    const float* p = &state_.set.position[3 * std::size_t{members_[k]}];
    return {p[0], p[1], p[2]};
  }

  // Lists the views that see member k.
  std::vector<Sight> sights_of(std::size_t k, const std::vector<SetView>& shown) const {
    const Gaussians4D& set = state_.set;
    const std::size_t i = members_[k];
    const math::Vec3 position = position_of(k);
    const float* s = &set.log_scale[3 * i];
    const float size = std::exp((s[0] + s[1] + s[2]) / 3.0f);
    std::vector<Sight> out;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      const math::Vec3 c = math::to_camera(views_.camera(v), position);
      const std::ptrdiff_t pixel = pixel_of(views_.camera(v), c);
      if (pixel < 0) continue;
      const float depth = shown[v].depth.data[static_cast<std::size_t>(pixel)];
      if (c.z > depth + std::max(kDepthSlack * depth, 2 * size)) continue;
      out.push_back({static_cast<std::uint32_t>(v), static_cast<std::uint32_t>(pixel)});
    }
    return out;
  }

  // Finds the sights of the members that may have ended.
  void find_suspects(const std::vector<SetView>& shown, const std::vector<ViewChange>& changed) {
    parallel_for(std::size_t{0}, members_.size(), [&](std::size_t k) {
      std::vector<Sight> sights = sights_of(k, shown);
      std::erase_if(sights, [&](const Sight& sight) { return !changed[sight.view].known(); });
      tallies_[k] = count(sights, changed);
      if (tallies_[k].seen >= 2 && tallies_[k].changed_share() >= kMinChanged)
        sights_[k] = std::move(sights);
    });
  }

  Cell cell_of(std::size_t k) const {
    const double side = kCellShare * capture_.scene_radius;
    const math::Vec3 p = position_of(k);
    return {static_cast<int>(std::floor(p.x / side)), static_cast<int>(std::floor(p.y / side)),
            static_cast<int>(std::floor(p.z / side))};
  }

  // Groups the members with sights.
  std::vector<Group> list_groups() const {
    std::map<Cell, Group> cells;
    for (std::size_t k = 0; k < sights_.size(); ++k)
      if (!sights_[k].empty()) cells[cell_of(k)].push_back(k);
    std::vector<Group> out;
    while (!cells.empty()) {
      std::vector<Cell> open{cells.begin()->first};
      Group group;
      while (!open.empty()) {
        const Cell cell = open.back();
        open.pop_back();
        const auto found = cells.find(cell);
        if (found == cells.end()) continue;
        group.insert(group.end(), found->second.begin(), found->second.end());
        cells.erase(found);
        for (int n = 0; n < 27; ++n)
          open.push_back({cell[0] + n % 3 - 1, cell[1] + n / 3 % 3 - 1, cell[2] + n / 9 - 1});
      }
      if (tally_of_likely(group).seen >= kMinViews) out.push_back(std::move(group));
    }
    return out;
  }

  bool is_likely(std::size_t k) const { return tallies_[k].changed_share() >= kLikelyChanged; }

  Tally tally_of_likely(const Group& group) const {
    Tally out;
    for (const std::size_t k : group)
      if (is_likely(k)) out += tallies_[k];
    return out;
  }

  // Lists the primitives of the state that are in none of the groups.
  std::vector<std::uint32_t> without(const std::vector<Group>& groups) const {
    std::vector<bool> left_out(members_.size(), false);
    for (const Group& group : groups)
      for (const std::size_t k : group) left_out[k] = true;
    std::vector<std::uint32_t> out;
    for (std::size_t k = 0; k < members_.size(); ++k)
      if (!left_out[k]) out.push_back(members_[k]);
    return out;
  }

  // Counts the views that `behind`, a rendering without suspects, shows better or worse.
  void tally_without(const std::vector<ViewChange>& changed,
                     const std::vector<ViewChange>& remaining, const std::vector<SetView>& behind) {
    parallel_for(std::size_t{0}, members_.size(), [&](std::size_t k) {
      for (const auto& [view, pixel] : sights_[k]) {
        const ViewChange &with = changed[view], &without = remaining[view];
        if (is_better(without, with, pixel) && behind[view].alpha.data[pixel] >= kMinKnownAlpha)
          ++tallies_[k].better;
        if (is_better(with, without, pixel)) ++tallies_[k].worse;
      }
    });
  }

  // Returns whether the images show content behind a group (1) or before it (-1), whether or not
  // the set has it; 0 if they do not determine that.
  int side_shown(const Group& group, const RayProbe& probe,
                 const std::vector<ViewChange>& changed) const {
    std::vector<std::pair<std::size_t, Sight>> sights;
    for (const std::size_t k : group) {
      if (!is_likely(k)) continue;
      for (const Sight& sight : sights_[k])
        if (changed[sight.view].has_changed(sight.pixel)) sights.emplace_back(k, sight);
    }
    const std::size_t count = std::min(sights.size(), kMaxProbes);
    std::vector<int> sides(count);
    parallel_for(std::size_t{0}, count, [&](std::size_t n) {
      const auto& [k, sight] = sights[n * sights.size() / count];
      const math::PinholeCamera& camera = views_.camera(sight.view);
      const auto width = static_cast<std::uint32_t>(camera.width);
      const float depth = probe.depth(sight.view, static_cast<int>(sight.pixel % width),
                                      static_cast<int>(sight.pixel / width), 0);
      const float own = math::to_camera(camera, position_of(k)).z;
      if (depth > (1 + kSideSlack) * own) sides[n] = 1;
      if (depth > 0 && depth < (1 - kSideSlack) * own) sides[n] = -1;
    });
    const auto behind = std::count(sides.begin(), sides.end(), 1),
               before = std::count(sides.begin(), sides.end(), -1);
    if (static_cast<double>(behind + before) < kMinDetermined * static_cast<double>(count))
      return 0;
    return behind >= kMinBehindFactor * before ? 1 : -1;
  }

  // Reduces the groups to those that have ended, and these to their primitives that match no view.
  void keep_ended(std::vector<Group>& groups, const RayProbe& probe,
                  const std::vector<ViewChange>& changed) const {
    std::erase_if(groups, [&](const Group& group) {
      const int side = side_shown(group, probe, changed);
      return side < 0 || (side == 0 && !is_uncovered(tally_of_likely(group)));
    });
    for (Group& group : groups) {
      std::erase_if(group, [&](std::size_t k) {
        return !is_likely(k) && tallies_[k].worse > kMaxWorseSingle * tallies_[k].changed;
      });
    }
  }

  // Finds the first frame from which on each group differs.
  Status find_ends(const std::vector<Group>& groups, const std::vector<SetView>& shown,
                   SceneChanges& out) const {
    std::vector<int> first(groups.size(), capture_.frames - 1);
    bool open = true;
    for (int frame = capture_.frames - 2; frame >= 0 && open; --frame) {
      STGS_ASSIGN(const std::vector<Image> images, views_.images(frame));
      const std::vector<ViewChange> changed = find_view_changes(shown, images, residuals_);
      open = false;
      for (std::size_t g = 0; g < groups.size(); ++g) {
        if (first[g] != frame + 1) continue;
        Tally tally;
        for (const std::size_t k : groups[g]) tally += count(sights_[k], changed);
        if (tally.changed_share() < kMinChangedShare) continue;
        first[g] = frame;
        open = true;
      }
    }
    for (std::size_t g = 0; g < groups.size(); ++g) {
      out.settled = std::max(out.settled, first[g]);
      for (const std::size_t k : groups[g]) out.ended.push_back({members_[k], first[g]});
    }
    if (2 * (capture_.frames - out.settled) < capture_.frames) out.settled = kUnsettled;
    std::sort(out.ended.begin(), out.ended.end(),
              [](const EndedPrimitive& a, const EndedPrimitive& b) { return a.index < b.index; });
    return {};
  }

  const PreparedCapture& capture_;
  const TrainState& state_;
  SetViews views_;
  std::vector<Residual> residuals_;
  std::vector<std::uint32_t> members_;      // persistent primitives of the state, ascending
  std::vector<std::vector<Sight>> sights_;  // of those that may have ended; empty: of others
  std::vector<Tally> tallies_;              // of all members
};

}  // namespace

Result<SceneChanges> find_changes(const PreparedCapture& capture, const TrainState& set,
                                  const std::vector<Residual>& residuals, int kernel,
                                  std::size_t max_points) {
  return ChangeFinder(capture, set, residuals, kernel).find(max_points);
}

std::vector<int> ends_of_fixed(const TrainState& state, const SceneChanges& changes) {
  std::vector<int> out;
  std::size_t next = 0;
  for (std::size_t i = 0; i < state.size(); ++i) {
    const bool ends = next < changes.ended.size() && changes.ended[next].index == i;
    if (state.is_fixed(i)) out.push_back(ends ? changes.ended[next].frame : -1);
    if (ends) ++next;
  }
  return out;
}

}  // namespace stgs::encoder
