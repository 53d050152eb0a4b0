// SPDX-License-Identifier: Apache-2.0
#include "init/hull.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace stgs::encoder::init {
namespace {

constexpr std::size_t kMaxCells = 2'000'000;
constexpr std::size_t kMaxExamined = 30'000'000;
constexpr double kBehindSlack = 1.06;  // tolerance for depth errors of the static surface

int views_needed(std::size_t views) {
  return int(std::min<std::size_t>(3, views));
}
int misses_allowed(int views) {
  return views / 8 + (views >= 5 ? 1 : 0);
}

// Visibility of a point in a view, and its position relative to the mask.
enum class Vote { kNotVisible, kOutside, kInside };

Vote vote_of(const Silhouette& s, const cv::Vec3d& p, double nearest) {
  const Pixel pixel = project(s.view, p);
  if (!pixel.inside || pixel.depth < nearest) return Vote::kNotVisible;
  if (!s.behind.empty()) {
    const float behind = s.behind.at<float>(pixel.y(), pixel.x());
    if (behind > 0 && pixel.depth > behind * kBehindSlack) return Vote::kNotVisible;
  }
  return s.mask.at<std::uint8_t>(pixel.y(), pixel.x()) ? Vote::kInside : Vote::kOutside;
}

bool point_inside(const std::vector<Silhouette>& silhouettes, const cv::Vec3d& p, double nearest) {
  int inside = 0, outside = 0;
  for (const Silhouette& s : silhouettes) {
    const Vote vote = vote_of(s, p, nearest);
    inside += vote == Vote::kInside;
    outside += vote == Vote::kOutside;
  }
  return inside >= views_needed(silhouettes.size()) && outside <= misses_allowed(inside + outside);
}

// Returns false only if no point of the ball can be inside. Approximates the projected ball by a
// rectangle that contains it.
bool ball_may_be_inside(const std::vector<Silhouette>& silhouettes, const cv::Vec3d& p,
                        double radius, double nearest) {
  int possible = 0, impossible = 0;
  for (const Silhouette& s : silhouettes) {
    const cv::Vec3d c = s.view.to_camera(p);
    if (c[2] + radius < nearest) continue;  // behind the camera
    if (c[2] - radius < nearest) {
      ++possible;  // contains the camera: undecidable
      continue;
    }
    // Upper bound of the outline's distance from the projected centre, also off the optical axis.
    const double x = c[0] / c[2], y = c[1] / c[2];
    const double spread = radius / (c[2] - radius) * std::sqrt(1 + x * x + y * y);
    const double rx = s.view.fx * spread + 1, ry = s.view.fy * spread + 1;
    const double u = s.view.fx * x + s.view.cx, v = s.view.fy * y + s.view.cy;
    if (u + rx < 0 || v + ry < 0 || u - rx > s.view.width || v - ry > s.view.height) continue;
    const bool fully_inside =
        u - rx >= 0 && v - ry >= 0 && u + rx <= s.view.width && v + ry <= s.view.height;
    const int x0 = std::max(0, int(u - rx)), x1 = std::min(s.view.width, int(u + rx) + 1);
    const int y0 = std::max(0, int(v - ry)), y1 = std::min(s.view.height, int(v + ry) + 1);
    const int sum = s.integral.at<int>(y1, x1) - s.integral.at<int>(y0, x1) -
                    s.integral.at<int>(y1, x0) + s.integral.at<int>(y0, x0);
    // A known static surface in front of the ball hides it, so the view cannot rule it out.
    if (sum > 0) {
      ++possible;
    } else if (fully_inside && s.behind.empty()) {
      ++impossible;
    } else if (fully_inside) {
      const cv::Rect box(x0, y0, x1 - x0, y1 - y0);
      double low = 0;
      cv::minMaxLoc(s.behind(box), &low, nullptr, nullptr, nullptr);
      impossible += low <= 0 || low * kBehindSlack > c[2] + radius ? 1 : 0;
    }
  }
  return possible >= views_needed(silhouettes.size()) &&
         impossible <= misses_allowed(possible + impossible);
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

}  // namespace

Silhouette make_silhouette(const View& view, const cv::Mat& mask, const cv::Mat& behind) {
  Silhouette out{view, mask, {}, behind};
  cv::Mat ones;
  cv::threshold(mask, ones, 0, 1, cv::THRESH_BINARY);
  cv::integral(ones, out.integral, CV_32S);
  return out;
}

// Builds the nodes of a hull from the leaves up.
class VisualHull::Carver {
 public:
  Carver(const std::vector<Silhouette>& silhouettes, const Box& bounds, double nearest,
         HullResolution resolution)
      : silhouettes_(silhouettes), bounds_(bounds), nearest_(nearest), resolution_(resolution) {}

  bool has_too_many(const VisualHull& hull) const {
    return hull.count_ > kMaxCells || examined_ > kMaxExamined;
  }
  // Returns the node of the part of a cube that is inside.
  std::int32_t carve(const HullCell& cube, VisualHull* hull) {
    ++examined_;
    if (has_too_many(*hull) || !meets(bounds_, cube)) return kOutside;
    if (cube.side < 1.5 * side_at(cube.centre)) {
      if (!point_inside(silhouettes_, cube.centre, nearest_)) return kOutside;
      ++hull->count_;
      return kInside;
    }
    const double radius = 0.87 * cube.side;  // half the diagonal
    if (!ball_may_be_inside(silhouettes_, cube.centre, radius, nearest_)) return kOutside;
    Node node;
    bool is_empty = true;
    for (int k = 0; k < 8; ++k) {
      node[k] = carve(part_of(cube, k), hull);
      is_empty = is_empty && node[k] == kOutside;
    }
    if (is_empty) return kOutside;
    hull->nodes_.push_back(node);
    return std::int32_t(hull->nodes_.size() - 1);
  }

 private:
  double side_at(const cv::Vec3d& p) const {
    double distance = 1e300;
    for (const Silhouette& s : silhouettes_) {
      distance = std::min(distance, cv::norm(s.view.centre - p));
    }
    return resolution_.side * std::max(1.0, distance / resolution_.depth);
  }

  const std::vector<Silhouette>& silhouettes_;
  const Box& bounds_;
  std::size_t examined_ = 0;
  double nearest_ = 0;
  HullResolution resolution_;
};

VisualHull VisualHull::carve(const std::vector<Silhouette>& silhouettes, const Box& bounds,
                             double nearest, HullResolution resolution) {
  VisualHull hull;
  if (bounds.empty() || silhouettes.size() < 2) return hull;
  const cv::Vec3d extent = bounds.high - bounds.low;
  hull.cube_.centre = 0.5 * (bounds.low + bounds.high);
  for (;; resolution.side *= 2) {
    hull.nodes_.clear();
    hull.count_ = 0;
    hull.cube_.side = resolution.side;
    const double longest = std::max({extent[0], extent[1], extent[2]});
    while (hull.cube_.side < longest) hull.cube_.side *= 2;
    Carver carver(silhouettes, bounds, nearest, resolution);
    hull.root_ = carver.carve(hull.cube_, &hull);
    if (!carver.has_too_many(hull)) return hull;
  }
}

bool VisualHull::contains(const cv::Vec3d& p) const {
  HullCell cube = cube_;
  const cv::Vec3d from_centre = p - cube.centre;
  for (int k = 0; k < 3; ++k) {
    if (!(std::abs(from_centre[k]) <= 0.5 * cube.side)) return false;
  }
  std::int32_t node = root_;
  while (node >= 0) {
    int part = 0;
    for (int k = 0; k < 3; ++k) part |= p[k] >= cube.centre[k] ? 1 << k : 0;
    node = nodes_[node][part];
    cube = part_of(cube, part);
  }
  return node == kInside;
}

void VisualHull::collect(std::int32_t node, const HullCell& cube,
                         std::vector<HullCell>* out) const {
  if (node == kOutside) return;
  if (node >= 0) {
    for (int k = 0; k < 8; ++k) collect(nodes_[node][k], part_of(cube, k), out);
    return;
  }
  for (int k = 0; k < 6; ++k) {
    cv::Vec3d step(0, 0, 0);
    step[k / 2] = k % 2 == 0 ? cube.side : -cube.side;
    if (contains(cube.centre + step)) continue;
    out->push_back(cube);
    return;
  }
}

std::vector<HullCell> VisualHull::surface() const {
  std::vector<HullCell> cells;
  collect(root_, cube_, &cells);
  return cells;
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
