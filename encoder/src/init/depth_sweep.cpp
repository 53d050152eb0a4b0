// SPDX-License-Identifier: Apache-2.0
#include "init/depth_sweep.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <opencv2/imgproc.hpp>

#include "geometry/path_costs.h"
#include "geometry/plane_sweep.h"
#include "geometry/stereo.h"
#include "geometry/sweep_mapping.h"
#include "geometry/sweep_rule.h"

namespace stgs::encoder::init {
namespace {

using geometry::CostVolume;
using geometry::kImpossible;

geometry::SweepSource sweep_source(const SweepImage& image) {
  return {image.corners.data(), image.usable_words.empty() ? nullptr : image.usable_words.data(),
          image.view.width, image.view.height};
}

double inverse_depth(const SweepPlanes& planes, double plane) {
  return 1.0 / planes.farthest + plane * plane_step(planes);
}

double plane_depth(const SweepSettings& settings, double plane) {
  return 1.0 / inverse_depth(settings, plane);
}

// Computes the costs of a plane against all sources, one per pixel of the region.
void compare_plane(const geometry::SweepReference& part,
                   const std::vector<const SweepImage*>& others,
                   const std::vector<geometry::SweepMapping>& mappings, double inverse,
                   geometry::PlaneCosts* costs, std::uint8_t* out) {
  geometry::reset(part, costs);
  for (std::size_t k = 0; k < others.size(); ++k) {
    const geometry::SweepMapping& m = mappings[k];
    const auto last = [&](int row) { return geometry::last_column(m, row, inverse); };
    const float h[9] = {m.x[0], m.y[0], last(0), m.x[1], m.y[1], last(1), m.x[2], m.y[2], last(2)};
    geometry::add_source(part, sweep_source(*others[k]), h, costs);
  }
  geometry::volume_costs(part, *costs, out);
}

void fill_volume(const SweepImage& reference, const std::vector<const SweepImage*>& others,
                 const SweepSettings& settings, const cv::Rect& region, CostVolume* volume) {
  const cv::Mat grey = reference.grey(region).clone();
  const cv::Mat mask = settings.mask.empty() ? cv::Mat() : settings.mask(region);
  const geometry::SweepReference part = geometry::make_sweep_reference(
      {grey.begin<float>(), grey.end<float>()}, region.width, region.height, geometry::kSweepWindow,
      mask.empty() ? nullptr : mask.data, std::ptrdiff_t(mask.step));
  std::vector<geometry::SweepMapping> mappings;
  for (const SweepImage* other : others) {
    mappings.push_back(geometry::sweep_mapping(sweep_camera(reference.view),
                                               sweep_camera(other->view), region.x, region.y));
  }
  const auto pixels = std::size_t(region.area());
  geometry::PlaneCosts costs;
  // The volume is written for several planes at a time, because those of a pixel are adjacent.
  constexpr int kPlanes = 16;
  std::vector<std::uint8_t> levels(kPlanes * pixels);
  for (int first = 0; first < volume->planes; first += kPlanes) {
    const int count = std::min(kPlanes, volume->planes - first);
    for (int k = 0; k < count; ++k) {
      compare_plane(part, others, mappings, inverse_depth(settings, first + k), &costs,
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
  DepthMap map = blank_map(size);
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

// Sweeps for a GPU, with the images that they use.
class SweepProblem {
 public:
  explicit SweepProblem(const std::vector<SweepImage>& images) : images_(images) {}

  // Adds a sweep; returns false if that would exceed the limit of a problem. The first always fits.
  bool add(const WantedDepth& wanted, DepthMap& map) {
    const std::size_t volume = std::size_t(map.depth.total()) * std::size_t(wanted.planes.planes);
    if (volume_ > 0 && volume_ + volume > geometry::kMaxSweepVolume) return false;
    volume_ += volume;
    geometry::ViewSweep sweep;
    sweep.reference = add_image(wanted.view);
    const geometry::SweepCamera camera = sweep_camera(images_[wanted.view].view);
    for (const int j : wanted.others) {
      sweep.sources.push_back(
          {add_image(j), geometry::sweep_mapping(camera, sweep_camera(images_[j].view), 0, 0)});
    }
    sweep.nearest = wanted.planes.nearest;
    sweep.farthest = wanted.planes.farthest;
    sweep.planes = wanted.planes.planes;
    sweep.depth = map.depth.ptr<float>();
    sweep.cost = map.cost.ptr<float>();
    problem_.sweeps.push_back(std::move(sweep));
    return true;
  }
  const geometry::ViewSweeps& problem() const { return problem_; }

 private:
  int add_image(int image) {
    const auto [at, is_new] = added_.try_emplace(image, int(problem_.images.size()));
    if (is_new) problem_.images.push_back(sweep_source(images_[image]));
    return at->second;
  }

  const std::vector<SweepImage>& images_;
  geometry::ViewSweeps problem_;
  std::map<int, int> added_;  // index in the problem of each image
  std::size_t volume_ = 0;
};

Status sweep_on_gpu(const std::vector<SweepImage>& images, const std::vector<WantedDepth>& wanted,
                    geometry::ViewSweeper& gpu, const Work& work, std::vector<DepthMap>* out) {
  for (std::size_t next = 0; next < wanted.size();) {
    STGS_TRY(work.check());
    SweepProblem batch(images);
    for (; next < wanted.size(); ++next)
      if (!wanted[next].others.empty() && !batch.add(wanted[next], (*out)[next])) break;
    if (!batch.problem().sweeps.empty()) STGS_TRY(gpu.run(batch.problem()));
  }
  return {};
}

}  // namespace

geometry::SweepCamera sweep_camera(const View& view) {
  geometry::SweepCamera out{view.width, view.height, view.fx, view.fy, view.cx, view.cy, {}, {}};
  std::copy_n(view.rotation.val, 9, out.rotation);
  std::copy_n(view.translation.val, 3, out.translation);
  return out;
}

DepthMap blank_map(cv::Size size) {
  return {cv::Mat(size, CV_32F, cv::Scalar(0)), cv::Mat(size, CV_32F, cv::Scalar(1))};
}

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

double plane_step(const SweepPlanes& planes) {
  return (1.0 / planes.nearest - 1.0 / planes.farthest) / (planes.planes - 1);
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

Status sweep_views(const std::vector<SweepImage>& images, const std::vector<WantedDepth>& wanted,
                   geometry::ViewSweeper* gpu, Work& work, std::vector<DepthMap>* out) {
  static_assert(kNeighbours <= geometry::kSweepSources);
  out->clear();
  for (const WantedDepth& one : wanted) out->push_back(blank_map(images[one.view].view.size()));
  if (gpu != nullptr)
    return work.wait_for([&] { return sweep_on_gpu(images, wanted, *gpu, work, out); });
  return work.for_each(int(wanted.size()), [&](int k) -> Status {
    const auto& [view, others, planes] = wanted[k];
    if (others.empty()) return {};
    std::vector<const SweepImage*> sources;
    for (const int j : others) sources.push_back(&images[j]);
    (*out)[k] = sweep(images[view], sources, SweepSettings{planes, {}, {}, {}});
    return {};
  });
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
