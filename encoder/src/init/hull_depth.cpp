// SPDX-License-Identifier: Apache-2.0
#include "init/hull_depth.h"

#include <algorithm>
#include <functional>
#include <opencv2/imgproc.hpp>

#include "init/static_points.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder::init {
namespace {

constexpr int kMinMaskPixels = 6;
constexpr int kFewestPlanes = 8;

// Returns the boxes around the components of the mask, a few pixels larger. Overlapping boxes are
// merged.
std::vector<cv::Rect> mask_boxes(const cv::Mat& mask) {
  cv::Mat grown, labels, stats, centroids;
  cv::dilate(mask, grown, cv::Mat(), {-1, -1}, 3);
  const int n = cv::connectedComponentsWithStats(grown, labels, stats, centroids);
  std::vector<cv::Rect> boxes;
  for (int i = 1; i < n; ++i) {
    cv::Rect box(stats.at<int>(i, cv::CC_STAT_LEFT), stats.at<int>(i, cv::CC_STAT_TOP),
                 stats.at<int>(i, cv::CC_STAT_WIDTH), stats.at<int>(i, cv::CC_STAT_HEIGHT));
    for (std::size_t k = 0; k < boxes.size();) {
      if ((boxes[k] & box).empty()) {
        ++k;
        continue;
      }
      box |= boxes[k];
      boxes.erase(boxes.begin() + std::ptrdiff_t(k));
      k = 0;  // the merged box may overlap others
    }
    boxes.push_back(box);
  }
  return boxes;
}

bool can_be_swept(const HullView& wanted) {
  return !wanted.partners.empty() && cv::countNonZero(wanted.mask) >= kMinMaskPixels;
}

int planes_of(const std::vector<SweepImage>& images, const HullView& wanted, double nearest,
              double farthest) {
  std::vector<View> views;
  views.reserve(images.size());
  for (const SweepImage& image : images) views.push_back(image.view);
  return plane_count(views[wanted.view], views, wanted.partners, nearest, farthest, kFewestPlanes,
                     geometry::kMaxHullPlanes);
}

SweptView sweep_view(const std::vector<SweepImage>& images, const HullView& wanted,
                     const DynamicHull& hull) {
  SweptView out;
  out.mask = wanted.mask;
  if (!can_be_swept(wanted)) return out;
  const SweepImage& reference = images[wanted.view];
  std::vector<const SweepImage*> others;
  others.reserve(wanted.partners.size());
  for (const int j : wanted.partners) others.push_back(&images[j]);
  out.map = blank_map(wanted.mask.size());
  for (const cv::Rect& box : mask_boxes(wanted.mask)) {
    SweepSettings settings;
    const auto range = hull_depths(hull.silhouettes, reference.view, wanted.mask, box, hull.limits);
    if (!range) continue;
    settings.nearest = range->nearest;
    settings.farthest = range->farthest;
    settings.planes = planes_of(images, wanted, settings.nearest, settings.farthest);
    settings.region = box;
    settings.mask = wanted.mask;
    settings.exclude = [&hull](const cv::Vec3d& origin, const cv::Vec3d& ray,
                               const std::vector<float>& depths,
                               std::vector<std::uint8_t>* excluded) {
      find_outside(hull.silhouettes, origin, ray, depths, hull.limits.nearest, excluded);
    };
    const DepthMap part = sweep(reference, others, settings);
    part.depth(box).copyTo(out.map.depth(box));
    part.cost(box).copyTo(out.map.cost(box));
    out.step = std::max(out.step, plane_step(settings));
  }
  return out;
}

// Returns the sweeps of the views that can be swept, and lists these. Results go to the maps of
// `out`.
geometry::HullSweep hull_sweep(const std::vector<SweepImage>& images,
                               const std::vector<HullView>& wanted, const DynamicHull& hull,
                               std::vector<SweptView>* out, std::vector<std::size_t>* chosen) {
  geometry::HullSweep problem;
  problem.nearest = hull.limits.nearest;
  problem.farthest = hull.limits.farthest;
  for (const Silhouette& s : hull.silhouettes)
    problem.silhouettes.push_back({sweep_camera(s.view), s.hiding.ptr<float>()});
  for (const SweepImage& image : images)
    problem.images.push_back(
        {sweep_camera(image.view), image.corners.empty() ? nullptr : image.corners.data()});
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    SweptView& swept = (*out)[k];
    swept.mask = wanted[k].mask;
    if (!can_be_swept(wanted[k])) continue;
    swept.map = blank_map(swept.mask.size());
    geometry::HullReference reference;
    reference.image = wanted[k].view;
    reference.sources = wanted[k].partners;
    reference.mask = swept.mask.ptr();
    for (const cv::Rect& box : mask_boxes(swept.mask))
      reference.boxes.push_back({box.x, box.y, box.width, box.height});
    reference.depth = swept.map.depth.ptr<float>();
    reference.cost = swept.map.cost.ptr<float>();
    problem.references.push_back(std::move(reference));
    chosen->push_back(k);
  }
  return problem;
}

Status sweep_on_gpu(const std::vector<SweepImage>& images, const std::vector<HullView>& wanted,
                    const DynamicHull& hull, geometry::HullSweeper& gpu,
                    std::vector<SweptView>* out) {
  std::vector<std::size_t> chosen;  // the view of each reference
  geometry::HullSweep problem = hull_sweep(images, wanted, hull, out, &chosen);
  if (chosen.empty()) return {};
  problem.planes = [&](int reference, double nearest, double farthest) {
    return planes_of(images, wanted[chosen[reference]], nearest, farthest);
  };
  STGS_TRY(gpu.run(problem));
  for (std::size_t r = 0; r < chosen.size(); ++r)
    (*out)[chosen[r]].step = problem.references[r].step;
  return {};
}

}  // namespace

Status sweep_hull(const std::vector<SweepImage>& images, const std::vector<HullView>& wanted,
                  const DynamicHull& hull, geometry::HullSweeper* gpu, const Work& work,
                  std::vector<SweptView>* out) {
  out->assign(wanted.size(), {});
  STGS_TRY(work.check());
  if (gpu != nullptr) return sweep_on_gpu(images, wanted, hull, *gpu, out);
  parallel_for(std::size_t{0}, wanted.size(), [&](std::size_t k) {
    if (work.check().ok()) (*out)[k] = sweep_view(images, wanted[k], hull);
  });
  return work.check();
}

}  // namespace stgs::encoder::init
