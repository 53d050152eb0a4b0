// SPDX-License-Identifier: Apache-2.0
// Computes dense depth of a view against its neighbours: a plane sweep over inverse depth with a
// cost of normalised correlation and colour, smoothed by semi-global matching in four directions.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "geometry/sweep_mapping.h"
#include "geometry/view_sweeper.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// A view with its image, at the resolution of the sweep.
struct SweepImage {
  View view;
  cv::Mat rgb;     // 8-bit
  cv::Mat grey;    // CV_32F, 0..255
  cv::Mat usable;  // 8-bit, 255 = usable
  // For the sweep: the corners of the grey values, and `usable`, which is empty if all pixels are.
  std::vector<std::uint32_t> corners, usable_words;
};
// Scales the image to the size of the view. An empty `usable` marks every pixel usable.
SweepImage make_sweep_image(const View& view, const cv::Mat& rgb, const cv::Mat& usable = {});

geometry::SweepCamera sweep_camera(const View& view);

// The planes of a sweep, evenly spaced in inverse depth.
struct SweepPlanes {
  double nearest = 1, farthest = 10;  // depth range, scene units
  int planes = 64;                    // 2 to geometry::kMaxSweepPlanes
};

// Returns the step in inverse depth between adjacent planes.
double plane_step(const SweepPlanes& planes);

struct SweepSettings : SweepPlanes {
  cv::Rect region;  // swept part of the reference; empty: all
  cv::Mat mask;     // 8-bit, 0: no depth is wanted; empty: everywhere
  // Sets excluded[k] to 1 for points origin + depths[k] * ray to exclude, such as those outside the
  // visual hull, else to 0. May be empty.
  std::function<void(const cv::Vec3d& origin, const cv::Vec3d& ray,
                     const std::vector<float>& depths, std::vector<std::uint8_t>* excluded)>
      exclude;
};

// Depth in scene units (0: unknown) and matching cost in [0, 1] at that depth. Both are CV_32F at
// the size of the reference.
struct DepthMap {
  cv::Mat depth, cost;
};
// Returns a map without depth, with cost 1.
DepthMap blank_map(cv::Size size);

// Sweeps the reference against the other views, on the CPU.
DepthMap sweep(const SweepImage& reference, const std::vector<const SweepImage*>& others,
               const SweepSettings& settings);

// A sweep of a whole view against others, at most kNeighbours.
struct WantedDepth {
  int view = 0;
  std::vector<int> others;  // empty: the depth is unknown
  SweepPlanes planes;
};
// Sweeps views of `images`. `gpu`: null for the CPU. One pass of a stage of `work`, which is
// checked for cancellation.
Status sweep_views(const std::vector<SweepImage>& images, const std::vector<WantedDepth>& wanted,
                   geometry::ViewSweeper* gpu, Work& work, std::vector<DepthMap>* out);

// Returns the number of maps in `others` that agree with the depth of `view` at (x, y), with an
// inverse depth closer than `tolerance`.
int agreement(const View& view, const DepthMap& map, int x, int y,
              const std::vector<std::pair<const View*, const DepthMap*>>& others, double tolerance);

}  // namespace stgs::encoder::init
