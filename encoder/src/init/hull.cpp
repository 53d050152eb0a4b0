// SPDX-License-Identifier: Apache-2.0
#include "init/hull.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace stgs::encoder::init {
namespace {

constexpr int kCoarseCells = 64;       // per side, to find the box of the hull
constexpr int kMaxCells = 192;         // per side
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

}  // namespace

Silhouette make_silhouette(const View& view, const cv::Mat& mask, const cv::Mat& behind) {
  Silhouette out{view, mask, {}, behind};
  cv::Mat ones;
  cv::threshold(mask, ones, 0, 1, cv::THRESH_BINARY);
  cv::integral(ones, out.integral, CV_32S);
  return out;
}

void VisualHull::allocate(const Box& box, double cell) {
  box_ = box;
  cell_ = cell;
  std::size_t cells = 1;
  for (int k = 0; k < 3; ++k) {
    size_[k] = std::max(1, int(std::ceil((box.high[k] - box.low[k]) / cell)));
    cells *= size_[k];
  }
  inside_.assign(cells, 0);
  count_ = 0;
}

void VisualHull::carve_cube(const std::vector<Silhouette>& silhouettes, double nearest,
                            bool conservative, int level, int x, int y, int z) {
  if (x >= size_[0] || y >= size_[1] || z >= size_[2]) return;
  const int side = 1 << level;
  const cv::Vec3d middle = box_.low + cell_ * (cv::Vec3d(x, y, z) + cv::Vec3d::all(0.5 * side));
  if (level == 0 && !conservative) {
    if (!point_inside(silhouettes, middle, nearest)) return;
  } else if (!ball_may_be_inside(silhouettes, middle, 0.87 * side * cell_, nearest)) {
    return;
  }
  if (level == 0) {
    inside_[index(x, y, z)] = 1;
    ++count_;
    return;
  }
  const int half = side / 2;
  for (int child = 0; child < 8; ++child) {
    carve_cube(silhouettes, nearest, conservative, level - 1, x + (child & 1) * half,
               y + (child >> 1 & 1) * half, z + (child >> 2) * half);
  }
}

VisualHull VisualHull::carve(const std::vector<Silhouette>& silhouettes, const Box& bounds,
                             double nearest, double cell) {
  VisualHull coarse;
  if (bounds.empty() || silhouettes.size() < 2) return coarse;
  const cv::Vec3d extent = bounds.high - bounds.low;
  const double longest_edge = std::max({extent[0], extent[1], extent[2]});
  const auto carve_all = [&](VisualHull& hull, bool conservative) {
    int level = 0;
    while ((1 << level) < std::max({hull.size_[0], hull.size_[1], hull.size_[2]})) ++level;
    hull.carve_cube(silhouettes, nearest, conservative, level, 0, 0, 0);
  };
  coarse.allocate(bounds, longest_edge / kCoarseCells);
  carve_all(coarse, true);
  if (coarse.empty()) return coarse;
  Box tight{cv::Vec3d::all(1e300), cv::Vec3d::all(-1e300)};
  for (int z = 0; z < coarse.size_[2]; ++z) {
    for (int y = 0; y < coarse.size_[1]; ++y) {
      for (int x = 0; x < coarse.size_[0]; ++x) {
        if (!coarse.inside_[coarse.index(x, y, z)]) continue;
        const cv::Vec3d c = coarse.centre(x, y, z);
        for (int k = 0; k < 3; ++k) {
          tight.low[k] = std::min(tight.low[k], c[k] - 0.5 * coarse.cell_);
          tight.high[k] = std::max(tight.high[k], c[k] + 0.5 * coarse.cell_);
        }
      }
    }
  }
  const cv::Vec3d size = tight.high - tight.low;
  VisualHull fine;
  fine.allocate(tight, std::max(cell, std::max({size[0], size[1], size[2]}) / kMaxCells));
  carve_all(fine, false);
  return fine;
}

std::vector<cv::Vec3d> VisualHull::surface() const {
  std::vector<cv::Vec3d> out;
  const auto filled = [&](int x, int y, int z) {
    return x >= 0 && y >= 0 && z >= 0 && x < size_[0] && y < size_[1] && z < size_[2] &&
           inside_[index(x, y, z)] != 0;
  };
  for (int z = 0; z < size_[2]; ++z) {
    for (int y = 0; y < size_[1]; ++y) {
      for (int x = 0; x < size_[0]; ++x) {
        if (!filled(x, y, z)) continue;
        const bool buried = filled(x - 1, y, z) && filled(x + 1, y, z) && filled(x, y - 1, z) &&
                            filled(x, y + 1, z) && filled(x, y, z - 1) && filled(x, y, z + 1);
        if (!buried) out.push_back(centre(x, y, z));
      }
    }
  }
  return out;
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
