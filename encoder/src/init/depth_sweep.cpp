// SPDX-License-Identifier: Apache-2.0
#include "init/depth_sweep.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "geometry/plane_sweep.h"
#include "geometry/stereo.h"
#include "geometry/sweep_rule.h"

namespace stgs::encoder::init {
namespace {

using geometry::kImpossible;

// Cost volume. The costs of all planes of a pixel are contiguous.
struct Volume {
  cv::Rect region;
  int planes = 0;
  std::vector<std::uint8_t> cost;
  std::size_t at(int x, int y) const { return (std::size_t(y) * region.width + x) * planes; }
};

// Maps pixel indices of the reference region to pixel indices of `other`, through the plane at
// `depth` parallel to the reference image.
cv::Matx33d plane_homography(const View& reference, const View& other, cv::Point origin,
                             double depth) {
  const cv::Matx33d k_other(other.fx, 0, other.cx - 0.5, 0, other.fy, other.cy - 0.5, 0, 0, 1);
  const cv::Matx33d inverse_k(1 / reference.fx, 0, (origin.x + 0.5 - reference.cx) / reference.fx,
                              0, 1 / reference.fy, (origin.y + 0.5 - reference.cy) / reference.fy,
                              0, 0, 1);
  const cv::Matx33d rotation = other.rotation * reference.rotation.t();
  const cv::Vec3d shift = (other.translation - rotation * reference.translation) * (1 / depth);
  cv::Matx33d m = rotation;
  for (int r = 0; r < 3; ++r) m(r, 2) += shift[r];
  return k_other * m * inverse_k;
}

double plane_depth(const SweepSettings& settings, double plane) {
  return 1.0 / (1.0 / settings.farthest + plane * plane_step(settings));
}

void fill_volume(const SweepImage& reference, const std::vector<const SweepImage*>& others,
                 const SweepSettings& settings, Volume* volume) {
  const cv::Rect region = volume->region;
  const cv::Mat grey = reference.grey(region).clone();
  const geometry::SweepReference part = geometry::make_sweep_reference(
      {grey.begin<float>(), grey.end<float>()}, region.width, region.height, settings.window);
  geometry::PlaneCosts costs;
  for (int plane = 0; plane < volume->planes; ++plane) {
    const double depth = plane_depth(settings, plane);
    geometry::reset(part, &costs);
    for (const SweepImage* other : others) {
      const cv::Matx33f h = plane_homography(reference.view, other->view, region.tl(), depth);
      float row_major[9];
      std::copy_n(h.val, 9, row_major);
      geometry::add_source(part,
                           {other->corners.data(),
                            other->usable_words.empty() ? nullptr : other->usable_words.data(),
                            other->view.width, other->view.height},
                           row_major, &costs);
    }
    for (int y = 0; y < region.height; ++y) {
      const std::size_t row = std::size_t(y) * part.pitch;
      std::uint8_t* out = &volume->cost[volume->at(0, y) + plane];
      for (std::size_t x = 0; x < std::size_t(region.width); ++x) {
        out[x * volume->planes] =
            geometry::volume_cost(costs.first[row + x], costs.second[row + x], costs.seen[row + x]);
      }
    }
  }
}

void exclude_impossible(const View& view, const SweepSettings& settings, Volume* volume) {
  const cv::Rect region = volume->region;
  std::vector<float> depths;
  for (int plane = 0; plane < volume->planes; ++plane)
    depths.push_back(float(plane_depth(settings, plane)));
  std::vector<std::uint8_t> excluded(depths.size(), 0);
  for (int y = 0; y < region.height; ++y) {
    for (int x = 0; x < region.width; ++x) {
      const cv::Point pixel = region.tl() + cv::Point(x, y);
      std::uint8_t* cost = &volume->cost[volume->at(x, y)];
      if (!settings.mask.empty() && settings.mask.at<std::uint8_t>(pixel) == 0) {
        std::fill_n(cost, volume->planes, kImpossible);
        continue;
      }
      if (settings.exclude)
        settings.exclude(view.centre, view.ray(pixel.x + 0.5, pixel.y + 0.5), depths, &excluded);
      for (int plane = 0; plane < volume->planes; ++plane)
        if (excluded[plane] != 0) cost[plane] = kImpossible;
    }
  }
}

// Adds the SGM path costs of the direction (dx, dy) to `sum`: paths reach (x, y) from
// (x - dx, y - dy).
void aggregate(const Volume& volume, const cv::Mat& grey, int dx, int dy,
               std::vector<std::uint16_t>* sum) {
  const int w = volume.region.width, h = volume.region.height, n = volume.planes;
  // A path needs only the costs of the previous row or pixel. Padded by one plane on each side.
  std::vector<std::vector<std::uint16_t>> previous(w), current(w);
  const auto blank = [n] { return std::vector<std::uint16_t>(n + 2, 0xffff); };
  for (int x = 0; x < w; ++x) previous[x] = current[x] = blank();
  std::vector<int> best_previous(w, 0), best_current(w, 0);
  for (int j = 0; j < h; ++j) {
    const int y = dy < 0 ? h - 1 - j : j;
    for (int i = 0; i < w; ++i) {
      const int x = dx < 0 ? w - 1 - i : i;
      const int px = x - dx, py = y - dy;
      const std::uint8_t* cost = &volume.cost[volume.at(x, y)];
      std::uint16_t* out = current[x].data() + 1;
      std::uint16_t* total = &(*sum)[volume.at(x, y)];
      int best = 0xffff;
      if (px < 0 || py < 0 || px >= w || py >= h) {
        for (int d = 0; d < n; ++d) out[d] = cost[d];
      } else {
        const std::uint16_t* from = (dy == 0 ? current : previous)[px].data() + 1;
        const int base = (dy == 0 ? best_current : best_previous)[px];
        const float edge = std::abs(grey.at<float>(y, x) - grey.at<float>(py, px));
        const int jump = base + geometry::large_step(edge);
        for (int d = 0; d < n; ++d) {
          const int side = std::min(from[d - 1], from[d + 1]) + geometry::kSmallStep;
          const int path = std::min({int(from[d]), side, jump});
          out[d] = std::uint16_t(cost[d] + path - base);
        }
      }
      for (int d = 0; d < n; ++d) {
        best = std::min(best, int(out[d]));
        total[d] = std::uint16_t(total[d] + out[d]);
      }
      best_current[x] = best;
    }
    std::swap(previous, current);
    std::swap(best_previous, best_current);
  }
}

// Returns the cheapest plane of each pixel, refined by a parabola through its neighbours.
DepthMap read_out(const Volume& volume, const std::vector<std::uint16_t>& sum, cv::Size size,
                  const SweepSettings& settings) {
  DepthMap map{cv::Mat(size, CV_32F, cv::Scalar(0)), cv::Mat(size, CV_32F, cv::Scalar(1))};
  const int n = volume.planes;
  for (int y = 0; y < volume.region.height; ++y) {
    for (int x = 0; x < volume.region.width; ++x) {
      const std::uint16_t* s = &sum[volume.at(x, y)];
      const int best = int(std::min_element(s, s + n) - s);
      const std::uint8_t cost = volume.cost[volume.at(x, y) + best];
      if (cost == kImpossible) continue;
      double offset = 0;
      if (best > 0 && best + 1 < n)
        offset = geometry::parabola_offset(s[best - 1], s[best], s[best + 1]);
      const cv::Point p(volume.region.x + x, volume.region.y + y);
      map.depth.at<float>(p) = float(plane_depth(settings, best + offset));
      map.cost.at<float>(p) = float(cost) / 254.0f;
    }
  }
  return map;
}

}  // namespace

SweepImage make_sweep_image(const View& view, const cv::Mat& rgb, const cv::Mat& usable) {
  SweepImage image{view, rgb, {}, usable, {}, {}};
  if (rgb.size() != view.size()) cv::resize(rgb, image.rgb, view.size(), 0, 0, cv::INTER_AREA);
  cv::Mat grey;
  cv::cvtColor(image.rgb, grey, cv::COLOR_RGB2GRAY);
  grey.convertTo(image.grey, CV_32F);
  image.corners = geometry::corners_of(grey.data, view.width, view.height);
  if (usable.empty()) {
    image.usable = cv::Mat(view.size(), CV_8U, cv::Scalar(255));
  } else if (usable.size() != view.size()) {
    cv::resize(usable, image.usable, view.size(), 0, 0, cv::INTER_NEAREST);
  }
  if (cv::countNonZero(image.usable) < int(image.usable.total()))
    image.usable_words.assign(image.usable.begin<std::uint8_t>(), image.usable.end<std::uint8_t>());
  return image;
}

double plane_step(const SweepSettings& settings) {
  return (1.0 / settings.nearest - 1.0 / settings.farthest) / (settings.planes - 1);
}

DepthMap sweep(const SweepImage& reference, const std::vector<const SweepImage*>& others,
               const SweepSettings& settings) {
  const cv::Rect all(0, 0, reference.view.width, reference.view.height);
  Volume volume;
  volume.region = settings.region.empty() ? all : settings.region & all;
  volume.planes = settings.planes;
  volume.cost.assign(std::size_t(volume.region.area()) * volume.planes, 0);
  fill_volume(reference, others, settings, &volume);
  if (settings.exclude || !settings.mask.empty())
    exclude_impossible(reference.view, settings, &volume);
  const cv::Mat grey = reference.grey(volume.region);
  std::vector<std::uint16_t> sum(volume.cost.size(), 0);
  aggregate(volume, grey, 1, 0, &sum);
  aggregate(volume, grey, -1, 0, &sum);
  aggregate(volume, grey, 0, 1, &sum);
  aggregate(volume, grey, 0, -1, &sum);
  return read_out(volume, sum, reference.view.size(), settings);
}

int agreement(const View& view, const DepthMap& map, int x, int y,
              const std::vector<std::pair<const View*, const DepthMap*>>& others,
              double tolerance) {
  const float depth = map.depth.at<float>(y, x);
  if (depth <= 0) return 0;
  const cv::Vec3d point = view.at(x + 0.5, y + 0.5, depth);
  int count = 0;
  for (const auto& [other, theirs] : others) {
    const Pixel p = project(*other, point);
    if (!p.inside) continue;
    const float d = theirs->depth.at<float>(p.y(), p.x());
    if (d > 0 && std::abs(1 / d - 1 / p.depth) < tolerance) ++count;
  }
  return count;
}

}  // namespace stgs::encoder::init
