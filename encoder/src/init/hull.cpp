// SPDX-License-Identifier: Apache-2.0
#include "init/hull.h"

#include <algorithm>
#include <utility>

#include "geometry/ray_votes.h"

namespace stgs::encoder::init {
namespace {

constexpr std::size_t kMaxCells = 2'000'000;
constexpr std::size_t kMaxExamined = 30'000'000;
constexpr double kHalfDiagonal = 0.87;  // of a cube, in sides

int views_needed(std::size_t views) {
  return int(std::min<std::size_t>(3, views));
}
int misses_allowed(int views) {
  return views / 8 + (views >= 5 ? 1 : 0);
}

// Whether a point that so many of the views see inside and outside of the mask is in the hull.
bool is_in_hull(int inside, int outside, std::size_t views) {
  return inside >= views_needed(views) && outside <= misses_allowed(inside + outside);
}

// Returns one of the eight parts of a cube; bit k of `part` is set in the upper half of axis k.
HullCell part_of(const HullCell& cube, int part) {
  HullCell out{cube.centre, 0.5 * cube.side};
  for (int k = 0; k < 3; ++k) {
    out.centre[k] += (part >> k & 1) != 0 ? 0.25 * cube.side : -0.25 * cube.side;
  }
  return out;
}

bool meets(const Box& box, const HullCell& cube) {
  for (int k = 0; k < 3; ++k) {
    if (cube.centre[k] + 0.5 * cube.side < box.low[k]) return false;
    if (cube.centre[k] - 0.5 * cube.side > box.high[k]) return false;
  }
  return true;
}

// Divides a cube into parts, down to the cells.
class Carver {
 public:
  Carver(const std::vector<Silhouette>& silhouettes, const Box& bounds, double nearest,
         HullResolution resolution)
      : silhouettes_(silhouettes), bounds_(bounds), nearest_(nearest), resolution_(resolution) {}

  // Returns false if there are too many cells.
  bool carve(const HullCell& cube) {
    Votes votes;
    for (std::size_t i = 0; i < silhouettes_.size(); ++i) votes.open.push_back(int(i));
    votes.near = votes.open;
    carve(cube, votes);
    return !has_too_many();
  }
  std::vector<HullCell> take() { return std::move(cells_); }

 private:
  // The views that matter to a cube. For its parts, only those in the lists are tested.
  struct Votes {
    int inside = 0, outside = 0;  // views that have this relation to the whole cube
    std::vector<int> open;        // views whose relations are not known
    std::vector<int> near;        // views that can be the nearest
  };

  bool has_too_many() const { return cells_.size() > kMaxCells || examined_ > kMaxExamined; }

  void carve(const HullCell& cube, const Votes& known) {
    ++examined_;
    if (has_too_many() || !meets(bounds_, cube)) return;
    Votes votes;
    if (!may_be_inside(cube, known, &votes)) return;
    if (cube.side < 1.5 * side_at(cube, known, &votes)) {
      if (has_point(cube, votes)) cells_.push_back(cube);
      return;
    }
    for (int k = 0; k < 8; ++k) carve(part_of(cube, k), votes);
  }

  // Returns false only if no point of the cube is inside.
  bool may_be_inside(const HullCell& cube, const Votes& known, Votes* votes) const {
    const double radius = kHalfDiagonal * cube.side;
    votes->inside = known.inside;
    votes->outside = known.outside;
    votes->open.reserve(known.open.size());
    int possible = known.inside;
    for (const int i : known.open) {
      const Relation relation = relation_of_ball(silhouettes_[i], cube.centre, radius, nearest_);
      votes->inside += relation == Relation::kInside ? 1 : 0;
      votes->outside += relation == Relation::kOutside ? 1 : 0;
      possible += relation == Relation::kInside || relation == Relation::kUndecided ? 1 : 0;
      if (relation == Relation::kUndecided || relation == Relation::kNotInside)
        votes->open.push_back(i);
    }
    return is_in_hull(possible, votes->outside, silhouettes_.size());
  }

  bool has_point(const HullCell& cube, const Votes& known) const {
    if (is_inside(cube.centre, known)) return true;
    for (int k = 0; k < 8; ++k)
      if (is_inside(part_of(cube, k).centre, known)) return true;
    return false;
  }

  bool is_inside(const cv::Vec3d& point, const Votes& known) const {
    int inside = known.inside, outside = known.outside;
    for (const int i : known.open) {
      const Relation relation = relation_of_point(silhouettes_[i], point, nearest_);
      inside += relation == Relation::kInside ? 1 : 0;
      outside += relation == Relation::kOutside ? 1 : 0;
    }
    return is_in_hull(inside, outside, silhouettes_.size());
  }

  // Returns the smallest side that is allowed at the cube, and the views that can be the nearest to
  // a point of it.
  double side_at(const HullCell& cube, const Votes& known, Votes* votes) const {
    double least = 1e300;
    const auto distance = [&](int i) {
      return cv::norm(silhouettes_[i].view.centre - cube.centre);
    };
    for (const int i : known.near) least = std::min(least, distance(i));
    const double farthest = least + 2 * kHalfDiagonal * cube.side;
    for (const int i : known.near)
      if (distance(i) <= farthest) votes->near.push_back(i);
    return resolution_.side * std::max(1.0, least / resolution_.depth);
  }

  const std::vector<Silhouette>& silhouettes_;
  const Box& bounds_;
  double nearest_ = 0;
  HullResolution resolution_;
  std::size_t examined_ = 0;
  std::vector<HullCell> cells_;
};

}  // namespace

void find_outside(const std::vector<Silhouette>& silhouettes, const cv::Vec3d& origin,
                  const cv::Vec3d& ray, const std::vector<float>& depths, double nearest,
                  std::vector<std::uint8_t>* outside) {
  geometry::RayVotes votes(depths);
  for (const Silhouette& silhouette : silhouettes) {
    const View& view = silhouette.view;
    geometry::VotingView voting{silhouette.hiding.ptr<float>(),
                                view.width,
                                view.height,
                                float(view.fx),
                                float(view.fy),
                                float(view.cx),
                                float(view.cy),
                                {},
                                {}};
    const cv::Vec3d start = view.to_camera(origin), along = view.rotation * ray;
    for (int k = 0; k < 3; ++k) {
      voting.start[k] = float(start[k]);
      voting.along[k] = float(along[k]);
    }
    geometry::add_votes(voting, float(nearest), &votes);
  }
  outside->resize(depths.size());
  for (std::size_t k = 0; k < depths.size(); ++k) {
    const int inside = int(votes.inside[k]), misses = int(votes.outside[k]);
    (*outside)[k] = is_in_hull(inside, misses, silhouettes.size()) ? 0 : 1;
  }
}

std::vector<HullCell> hull_cells(const std::vector<Silhouette>& silhouettes, const Box& bounds,
                                 double nearest, HullResolution resolution) {
  if (bounds.empty() || silhouettes.size() < 2) return {};
  const cv::Vec3d extent = bounds.high - bounds.low;
  const double longest = std::max({extent[0], extent[1], extent[2]});
  for (;; resolution.side *= 2) {
    HullCell cube{0.5 * (bounds.low + bounds.high), resolution.side};
    while (cube.side < longest) cube.side *= 2;
    Carver carver(silhouettes, bounds, nearest, resolution);
    if (carver.carve(cube)) return carver.take();
  }
}

Box visible_box(const std::vector<View>& views, double nearest, double farthest, int views_needed) {
  Box box{cv::Vec3d::all(1e300), cv::Vec3d::all(-1e300)};
  constexpr int kSteps = 9;  // samples along each axis of a frustum
  for (const View& view : views) {
    for (int i = 0; i < kSteps * kSteps * kSteps; ++i) {
      const double a = double(i % kSteps) / (kSteps - 1);
      const int row = i / kSteps, layer = row / kSteps;
      const double b = double(row % kSteps) / (kSteps - 1);
      const double c = double(layer) / (kSteps - 1);
      const double depth = 1 / (1 / nearest + c * (1 / farthest - 1 / nearest));
      const cv::Vec3d p = view.at(a * view.width, b * view.height, depth);
      int visible = 0;
      for (const View& other : views) {
        const Pixel pixel = project(other, p);
        const double slack = 0.05 * std::max(other.width, other.height);
        visible += pixel.depth > 0.5 * nearest && pixel.u > -slack && pixel.v > -slack &&
                   pixel.u < other.width + slack && pixel.v < other.height + slack;
      }
      if (visible < views_needed) continue;
      for (int k = 0; k < 3; ++k) {
        box.low[k] = std::min(box.low[k], p[k]);
        box.high[k] = std::max(box.high[k], p[k]);
      }
    }
  }
  return box;
}

}  // namespace stgs::encoder::init
