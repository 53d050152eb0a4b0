// SPDX-License-Identifier: Apache-2.0
#include "init/silhouette.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace stgs::encoder::init {
namespace {

cv::Mat integral_of(const cv::Mat& mask) {
  cv::Mat ones, out;
  cv::threshold(mask, ones, 0, 1, cv::THRESH_BINARY);
  cv::integral(ones, out, CV_32S);
  return out;
}

int count_in(const cv::Mat& integral, const cv::Rect& box) {
  const int *top = integral.ptr<int>(box.y), *bottom = integral.ptr<int>(box.y + box.height);
  const int left = box.x, right = box.x + box.width;
  return bottom[right] - top[right] - bottom[left] + top[left];
}

using Levels = std::vector<cv::Mat>;

// Returns a bound of the depths in a box: the best over the blocks that meet it, at most three
// along each axis. `better` returns one of two depths.
template <class Better>
float bound_in(const Levels& levels, const cv::Rect& box, const Better& better) {
  const auto longest = static_cast<unsigned>(std::max(box.width, box.height));
  const int level = std::min(int(std::bit_width(longest)), int(levels.size())) - 1;
  const cv::Mat& blocks = levels[level];
  float best = blocks.at<float>(box.y >> level, box.x >> level);
  for (int y = box.y >> level; y <= (box.y + box.height - 1) >> level; ++y) {
    const float* row = blocks.ptr<float>(y);
    for (int x = box.x >> level; x <= (box.x + box.width - 1) >> level; ++x)
      best = better(best, row[x]);
  }
  return best;
}

float least_of(float a, float b) {
  return std::min(a, b);
}
float greatest_of(float a, float b) {
  return std::max(a, b);
}

template <class Better>
Levels levels_of(const cv::Mat& depth, const Better& better) {
  Levels out{depth};
  while (out.back().rows > 1 || out.back().cols > 1) {
    const cv::Mat& fine = out.back();
    cv::Mat half((fine.rows + 1) / 2, (fine.cols + 1) / 2, CV_32F);
    for (int y = 0; y < half.rows; ++y) {
      const float *a = fine.ptr<float>(2 * y),
                  *b = fine.ptr<float>(std::min(2 * y + 1, fine.rows - 1));
      for (int x = 0; x < half.cols; ++x) {
        const int right = std::min(2 * x + 1, fine.cols - 1);
        half.at<float>(y, x) = better(better(a[2 * x], a[right]), better(b[2 * x], b[right]));
      }
    }
    out.push_back(half);
  }
  return out;
}

// Whether everything in a box up to a depth is in front of the surface, or everything from it on is
// behind.
bool is_in_front(const Backdrop& backdrop, const cv::Rect& box, double depth) {
  return bound_in(backdrop.nearest, box, least_of) >= depth;
}
bool is_behind(const Backdrop& backdrop, const cv::Rect& box, double depth) {
  return bound_in(backdrop.farthest, box, greatest_of) < depth;
}

}  // namespace

Backdrop make_backdrop(const cv::Mat& depth) {
  Backdrop out;
  cv::Mat known = depth.clone();
  known.setTo(std::numeric_limits<float>::max(), depth <= 0);
  out.nearest = levels_of(known, least_of);
  out.farthest = levels_of(known, greatest_of);
  return out;
}

Silhouette make_silhouette(const View& view, const cv::Mat& mask,
                           std::shared_ptr<const Backdrop> backdrop) {
  cv::Mat hiding(view.size(), CV_32F, cv::Scalar(std::numeric_limits<float>::max()));
  if (backdrop != nullptr) backdrop->nearest[0].copyTo(hiding);
  cv::Mat(-hiding).copyTo(hiding, mask);
  return {view, hiding, integral_of(mask), std::move(backdrop)};
}

Relation relation_of_point(const Silhouette& silhouette, const cv::Vec3d& point, double nearest) {
  const Pixel pixel = project(silhouette.view, point);
  if (!pixel.inside || pixel.depth < nearest) return Relation::kNotVisible;
  const float hiding = silhouette.hiding.ptr<float>(pixel.y())[pixel.x()];
  if (pixel.depth > std::abs(hiding)) return Relation::kNotVisible;
  return hiding < 0 ? Relation::kInside : Relation::kOutside;
}

Relation relation_of_ball(const Silhouette& silhouette, const cv::Vec3d& centre, double radius,
                          double nearest) {
  const View& view = silhouette.view;
  const cv::Vec3d c = view.to_camera(centre);
  if (c[2] + radius < nearest) return Relation::kNotVisible;  // behind the camera
  if (c[2] - radius < nearest) return Relation::kUndecided;   // a part is too near
  // Upper bound of the outline's distance from the projected centre, also off the optical axis.
  const double x = c[0] / c[2], y = c[1] / c[2];
  const double spread = radius / (c[2] - radius) * std::sqrt(1 + x * x + y * y);
  const double rx = view.fx * spread + 1, ry = view.fy * spread + 1;
  const double u = view.fx * x + view.cx, v = view.fy * y + view.cy;
  if (u + rx < 0 || v + ry < 0 || u - rx > view.width || v - ry > view.height)
    return Relation::kNotVisible;
  const auto clamped = [](double at, int size) { return int(std::clamp(at, 0.0, double(size))); };
  const int x0 = clamped(u - rx, view.width), y0 = clamped(v - ry, view.height);
  const cv::Rect box(x0, y0, clamped(u + rx + 1, view.width) - x0,
                     clamped(v + ry + 1, view.height) - y0);
  if (box.empty()) return Relation::kNotVisible;
  const int moving = count_in(silhouette.integral, box);
  const Backdrop* backdrop = silhouette.backdrop.get();
  if (backdrop != nullptr && is_behind(*backdrop, box, c[2] - radius)) return Relation::kNotVisible;
  const bool is_seen = u - rx >= 0 && v - ry >= 0 && u + rx <= view.width &&
                       v + ry <= view.height &&
                       (backdrop == nullptr || is_in_front(*backdrop, box, c[2] + radius));
  if (moving == 0) return is_seen ? Relation::kOutside : Relation::kNotInside;
  return is_seen && moving == box.area() ? Relation::kInside : Relation::kUndecided;
}

}  // namespace stgs::encoder::init
