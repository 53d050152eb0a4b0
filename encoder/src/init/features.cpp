// SPDX-License-Identifier: Apache-2.0
#include "init/features.h"

#include <algorithm>
#include <chrono>

#include "init/colmap_points.h"

namespace stgs::encoder::init {
namespace {

constexpr int kColmapViews = 12;     // more views add little, and time grows with their square
constexpr int kColmapSeconds = 120;  // limit per step of COLMAP

}  // namespace

void FeatureSearch::start(const PreparedCapture& capture, const std::vector<View>& views,
                          bool separate_motion, const Work& work) {
  if (views.size() < 2) return;
  if (!colmap_installed()) {
    work.log("features: skipped (COLMAP is not installed)", 1);
    return;
  }
  search_ = std::async(std::launch::async, [this, &capture, &views, separate_motion] {
    Result<std::vector<SurfacePoint>> points{std::vector<SurfacePoint>{}};
    const Status status = guarded("colmap", [&]() -> Status {
      STGS_ASSIGN(points, colmap_points(capture, views, kColmapViews, separate_motion,
                                        kColmapSeconds, abandoned_));
      return {};
    });
    return status.ok() ? points : Result<std::vector<SurfacePoint>>{status};
  });
}

Result<std::vector<SurfacePoint>> FeatureSearch::points(const std::vector<View>& views,
                                                        const DepthRange& range, Work& work) {
  std::vector<SurfacePoint> points;
  if (!search_.valid()) return points;
  work.stage("features");
  const auto ready = [&]() -> Status {
    while (search_.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready) {
      STGS_TRY(work.check());
    }
    return {};
  };
  STGS_TRY(work.wait_for(ready));
  const auto found = search_.get();
  if (!found.ok()) {
    work.log(fmt::format("features: none ({})", found.status().message()), 1);
    return points;
  }
  // A point outside the measured depth range in every view is a mismatch.
  for (const SurfacePoint& point : *found) {
    const bool plausible = std::any_of(views.begin(), views.end(), [&](const View& view) {
      const Pixel p = project(view, point.position);
      return p.inside && p.depth > range.nearest && p.depth < range.farthest;
    });
    if (plausible) points.push_back(point);
  }
  work.log(found->empty()
               ? fmt::format("features: none (COLMAP found no matches between {} views)",
                             std::min(kColmapViews, int(views.size())))
               : fmt::format("features: {} points triangulated by COLMAP", points.size()));
  return points;
}

}  // namespace stgs::encoder::init
