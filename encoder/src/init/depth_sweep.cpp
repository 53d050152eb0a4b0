// SPDX-License-Identifier: Apache-2.0
#include "init/depth_sweep.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "geometry/path_costs.h"
#include "geometry/plane_sweep.h"
#include "geometry/stereo.h"
#include "geometry/sweep_rule.h"

namespace stgs::encoder::init {
namespace {

using geometry::CostVolume;
using geometry::kImpossible;

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

// Computes the costs of a plane against all sources, one per pixel of the region.
void compare_plane(const SweepImage& reference, const std::vector<const SweepImage*>& others,
                   const geometry::SweepReference& part, cv::Point origin, double depth,
                   geometry::PlaneCosts* costs, std::uint8_t* out) {
  geometry::reset(part, costs);
  for (const SweepImage* other : others) {
    const cv::Matx33f h = plane_homography(reference.view, other->view, origin, depth);
    float row_major[9];
    std::copy_n(h.val, 9, row_major);
    geometry::add_source(
        part,
        {other->corners.data(), other->usable_words.empty() ? nullptr : other->usable_words.data(),
         other->view.width, other->view.height},
        row_major, costs);
  }
  geometry::volume_costs(part, *costs, out);
}

void fill_volume(const SweepImage& reference, const std::vector<const SweepImage*>& others,
                 const SweepSettings& settings, const cv::Rect& region, CostVolume* volume) {
  const cv::Mat grey = reference.grey(region).clone();
  const cv::Mat mask = settings.mask.empty() ? cv::Mat() : settings.mask(region);
  const geometry::SweepReference part = geometry::make_sweep_reference(
      {grey.begin<float>(), grey.end<float>()}, region.width, region.height, settings.window,
      mask.empty() ? nullptr : mask.data, std::ptrdiff_t(mask.step));
  const auto pixels = std::size_t(region.area());
  geometry::PlaneCosts costs;
  // The volume is written for several planes at a time, because those of a pixel are adjacent.
  constexpr int kPlanes = 16;
  std::vector<std::uint8_t> levels(kPlanes * pixels);
  for (int first = 0; first < volume->planes; first += kPlanes) {
    const int count = std::min(kPlanes, volume->planes - first);
    for (int k = 0; k < count; ++k) {
      compare_plane(reference, others, part, region.tl(), plane_depth(settings, first + k), &costs,
                    &levels[k * pixels]);
    }
    std::uint8_t* out = &volume->cost[first];
    for (std::size_t i = 0; i < pixels; ++i, out += volume->pitch)
      for (int k = 0; k < count; ++k) out[k] = levels[k * pixels + i];
  }
}

void exclude_impossible(const View& view, const SweepSettings& settings, const cv::Rect& region,
                        CostVolume* volume) {
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

// Returns the cheapest plane of each pixel, refined by a parabola through its neighbours.
DepthMap read_out(const CostVolume& volume, const cv::Rect& region, cv::Size size,
                  const SweepSettings& settings) {
  DepthMap map{cv::Mat(size, CV_32F, cv::Scalar(0)), cv::Mat(size, CV_32F, cv::Scalar(1))};
  const int n = volume.planes;
  for (int y = 0; y < volume.height; ++y) {
    for (int x = 0; x < volume.width; ++x) {
      const std::uint16_t* s = &volume.sum[volume.at(x, y)];
      const int best = int(std::min_element(s, s + n) - s);
      const std::uint8_t cost = volume.cost[volume.at(x, y) + best];
      if (cost == kImpossible) continue;
      double offset = 0;
      if (best > 0 && best + 1 < n)
        offset = geometry::parabola_offset(s[best - 1], s[best], s[best + 1]);
      const cv::Point p(region.x + x, region.y + y);
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
  const cv::Rect region = settings.region.empty() ? all : settings.region & all;
  CostVolume volume(region.width, region.height, settings.planes);
  fill_volume(reference, others, settings, region, &volume);
  if (settings.exclude || !settings.mask.empty())
    exclude_impossible(reference.view, settings, region, &volume);
  const cv::Mat part = reference.grey(region).clone();
  const std::vector<float> grey(part.begin<float>(), part.end<float>());
  for (const int step : {1, -1}) {
    geometry::add_paths(grey, step, 0, &volume);
    geometry::add_paths(grey, 0, step, &volume);
  }
  return read_out(volume, region, reference.view.size(), settings);
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
