// SPDX-License-Identifier: Apache-2.0
// Finds static points: depth of the median backgrounds, fused into points that cover every view.
#pragma once

#include <vector>

#include "init/cover.h"
#include "init/depth_sweep.h"
#include "init/init.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Range of the visible depths in the training cameras, scene units.
struct DepthRange {
  double nearest = 0, farthest = 0;
  bool measured = false;  // false: estimated from the cameras alone
};

// A view with an image of its static content.
struct StaticImage {
  View view;
  cv::Mat rgb, usable;  // 8-bit; `usable` is 255 where rgb is valid, or empty: everywhere
};

struct StaticScene {
  DepthRange range;
  double far = 0;  // distance of sky and far background from the views, scene units; 0: none
  Focus focus;
  std::vector<Surface> surfaces;  // per view; depth is dense, weight is above 0 where confirmed
  std::vector<cv::Mat> usable;    // per view, 8-bit: 255 where the background is valid
  std::vector<SurfacePoint> points;
  int swept = 0, given = 0, filled = 0;  // points by origin
};

// Measures the depth range and the focus by coarse sweeps. inputs[k][view] is image k of a view;
// the images with the same k are swept against each other. `gpu`: of the sweeps; null for the CPU.
Status find_depth_range(const std::vector<std::vector<StaticImage>>& inputs,
                        geometry::ViewSweeper* gpu, Work& work, StaticScene* scene);

// Computes the dense depth of every image, confirmed across views. Holes are interpolated. `gpu`:
// as above.
Status find_static_depth(const std::vector<StaticImage>& inputs, geometry::ViewSweeper* gpu,
                         Work& work, StaticScene* scene);

// How stereo runs.
struct StereoChoice {
  std::string backend;  // geometry/view_matcher.h
  int gpu = 0;
  std::uint64_t seed = 1;  // of its random planes
};

// Improves that depth, and adds normals, by stereo, unless there are fewer than three images; then
// places sky and far background, and moves interpolated depth that other views contradict.
// Stages "stereo" and "far background".
Status refine_static_depth(const std::vector<StaticImage>& inputs, const StereoChoice& choice,
                           Work& work, StaticScene* scene);

// Selects at most `limit` points: from `given` first, then confirmed depth, then interpolated
// depth.
void choose_static_points(const std::vector<SurfacePoint>& given, int limit, StaticScene* scene);

// Returns the number of sweep planes that are about a pixel apart in the other views, clamped to
// [low, high].
int plane_count(const View& view, const std::vector<View>& views, const std::vector<int>& others,
                double nearest, double farthest, int low, int high);

// Returns points that came with the capture. With `separate_motion`, without those that are on
// dynamic content in frame 0.
Result<std::vector<SurfacePoint>> given_points(const PreparedCapture& capture,
                                               const std::vector<View>& views,
                                               const std::vector<InitialPoint>& points,
                                               bool separate_motion);

}  // namespace stgs::encoder::init
