// SPDX-License-Identifier: Apache-2.0
#include "init/dynamic_points.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "stgs/format/parallel.h"

namespace stgs::encoder::init {
namespace {

// Runs task(i) for i in [0, count) on all threads. It is nested in a loop over frames, because a
// live window has fewer frames than there are threads. Returns the error of the lowest index.
Status in_parallel(int count, const std::function<Status(int)>& task) {
  std::vector<Status> statuses(count);
  parallel_for(0, count, [&](int i) { statuses[i] = task(i); });
  for (Status& status : statuses) STGS_TRY(status);
  return {};
}

constexpr double kConfirmedSlack = 1.06, kInterpolatedSlack = 1.3;  // for errors of static depth

// Returns the depth behind which the static surface hides everything, at the size of the view.
cv::Mat hiding_depth_of(const Surface& surface, const View& view) {
  cv::Mat depth = kInterpolatedSlack * surface.depth, out;
  cv::Mat(kConfirmedSlack * surface.depth).copyTo(depth, surface.weight > 0);
  cv::resize(depth, out, view.size(), 0, 0, cv::INTER_NEAREST);
  return out;
}

// Returns the mask without its border, where pixels mix foreground and background. Parts too thin
// to have an interior are kept.
cv::Mat inner_mask(const cv::Mat& mask) {
  cv::Mat inner, covered;
  cv::erode(mask, inner, cv::getStructuringElement(cv::MORPH_CROSS, {3, 3}));
  cv::dilate(inner, covered, cv::getStructuringElement(cv::MORPH_RECT, {5, 5}));
  return inner | (mask & ~covered);
}

// Returns the depth inside the mask as a surface. The weight exceeds 1 where another swept view
// agrees.
Surface surface_of(const SweepImage& image, const SweptView& swept,
                   const std::vector<std::pair<const View*, const DepthMap*>>& others) {
  Surface surface{image.view, image.rgb, swept.map.depth.clone(),
                  cv::Mat(image.view.size(), CV_32F, cv::Scalar(0))};
  const cv::Mat mask = inner_mask(swept.mask);
  for (int y = 0; y < image.view.height; ++y) {
    for (int x = 0; x < image.view.width; ++x) {
      if (!mask.at<std::uint8_t>(y, x) || surface.depth.at<float>(y, x) <= 0) continue;
      const float cost = swept.map.cost.at<float>(y, x);
      const bool agreed = agreement(image.view, swept.map, x, y, others, 2 * swept.step) > 0;
      surface.weight.at<float>(y, x) = std::max(0.01f, 1 - cost) + (agreed ? 1.0f : 0.0f);
    }
  }
  return surface;
}

// Sets the weight to 0 where no other view confirms the depth.
std::vector<Surface> checked_only(std::vector<Surface> surfaces) {
  for (Surface& surface : surfaces) {
    surface.weight = surface.weight.clone();
    surface.weight.setTo(0, surface.weight <= 1.2f);
  }
  return surfaces;
}

void choose(const std::vector<Surface>& surfaces, double tolerance, int limit, DynamicFrame* out) {
  const int block = cover_within(checked_only(surfaces), limit, tolerance, &out->points);
  out->checked = int(out->points.size());
  // Unconfirmed surfaces also need initial points. The hull limits their depth error.
  for (int wide = std::max(3, block);; wide = wide * 5 / 4 + 1) {
    std::vector<SurfacePoint> all = out->points;
    cover(surfaces, wide, 3 * tolerance, &all);
    if (int(all.size()) > limit && wide < 4096) continue;
    if (int(all.size()) <= limit) out->points = std::move(all);
    return;
  }
}

}  // namespace

DynamicFinder::DynamicFinder(const PreparedCapture& capture, const std::vector<View>& views,
                             const StaticScene& scene, const DynamicSettings& settings,
                             geometry::HullSweeper* gpu)
    : capture_(capture),
      scene_(scene),
      settings_(settings),
      gpu_(gpu),
      limits_{0.6 * scene.range.nearest, scene.range.farthest} {
  for (std::size_t i = 0; i < views.size(); ++i) {
    hull_.push_back(make_view(*views[i].camera, settings.hull_side));
    hiding_.push_back(hiding_depth_of(scene.surfaces[i], hull_[i]));
    small_.push_back(make_view(*views[i].camera, settings.max_side));
  }
  references_ = spread(small_, settings.references);
  for (std::size_t i = 0; i < small_.size(); ++i)
    partners_.push_back(neighbours(small_, int(i), scene.focus.point, kNeighbours));
}

Status DynamicFinder::load_silhouettes(int frame, std::vector<Silhouette>* out) const {
  std::vector<std::optional<Silhouette>> found(hull_.size());
  const Status loaded = in_parallel(int(hull_.size()), [&](int i) -> Status {
    STGS_ASSIGN(const cv::Mat mask, load_mask_image(capture_, hull_[i], frame));
    if (!mask.empty()) found[i] = make_silhouette(hull_[i], mask, hiding_[i]);
    return {};
  });
  STGS_TRY(loaded);
  for (std::optional<Silhouette>& silhouette : found)
    if (silhouette) out->push_back(*std::move(silhouette));
  return {};
}

Status DynamicFinder::sweep_references(int frame, const DynamicHull& hull, const Work& work,
                                       DynamicFrame* out) const {
  std::vector<bool> is_used(small_.size(), false);
  for (const int i : references_) {
    is_used[i] = true;
    for (const int j : partners_[i]) is_used[j] = true;
  }
  std::vector<SweepImage> images(small_.size());
  std::vector<cv::Mat> masks(small_.size());
  const Status loaded = in_parallel(int(small_.size()), [&](int i) -> Status {
    if (!is_used[i] || !has_frame(capture_, *small_[i].camera, frame)) return {};
    STGS_TRY(work.check());
    STGS_ASSIGN(masks[i], load_mask_image(capture_, small_[i], frame));
    STGS_ASSIGN(const cv::Mat rgb, load_image(capture_, small_[i], frame));
    images[i] = make_sweep_image(small_[i], rgb);
    return {};
  });
  STGS_TRY(loaded);
  std::vector<HullView> wanted;
  for (const int i : references_) {
    std::vector<int> partners = partners_[i];
    std::erase_if(partners, [&](int j) { return images[j].rgb.empty(); });
    if (!masks[i].empty()) wanted.push_back({i, masks[i], std::move(partners)});
  }
  std::vector<SweptView> swept;
  STGS_TRY(sweep_hull(images, wanted, hull, gpu_, work, &swept));
  std::vector<std::size_t> mapped;  // views with a depth map
  double tolerance = 0;
  for (std::size_t k = 0; k < swept.size(); ++k) {
    if (swept[k].map.depth.empty()) continue;
    mapped.push_back(k);
    tolerance = std::max(tolerance, 3 * swept[k].step);
  }
  std::vector<Surface> surfaces(mapped.size());
  parallel_for(std::size_t{0}, mapped.size(), [&](std::size_t m) {
    std::vector<std::pair<const View*, const DepthMap*>> others;
    for (const std::size_t k : mapped)
      if (k != mapped[m]) others.emplace_back(&small_[wanted[k].view], &swept[k].map);
    const std::size_t k = mapped[m];
    surfaces[m] = surface_of(images[wanted[k].view], swept[k], others);
  });
  if (!surfaces.empty()) choose(surfaces, tolerance, settings_.limit, out);
  return {};
}

Status DynamicFinder::find(int frame, const Work& work, DynamicFrame* out) const {
  DynamicHull hull{{}, limits_};
  STGS_TRY(load_silhouettes(frame, &hull.silhouettes));
  const auto with_motion = std::count_if(hull.silhouettes.begin(), hull.silhouettes.end(),
                                         [](const Silhouette& s) { return s.shows_motion; });
  return with_motion < 2 ? Status{} : sweep_references(frame, hull, work, out);
}

}  // namespace stgs::encoder::init
