// SPDX-License-Identifier: Apache-2.0
// Dense depth of a view against its neighbours: a plane sweep over inverse depth, scored by
// normalised correlation and colour, smoothed by semi-global matching along four directions.
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// A view and its picture, prepared for sweeping.
struct SweepPicture {
  View view;
  cv::Mat rgb;     // 8-bit
  cv::Mat grey;    // CV_32F, 0..255
  cv::Mat usable;  // 8-bit, 255 where the picture may be trusted; empty: everywhere
};
SweepPicture sweep_picture(const View& view, const cv::Mat& rgb, const cv::Mat& usable = {});

struct SweepSettings {
  double nearest = 1, farthest = 10;  // depth, scene units
  int planes = 64;                    // 2..192
  int window = 5;                     // pixels, odd
  cv::Rect region;                    // of the reference that is swept; empty: all of it
  // Hypotheses that are impossible (outside the visual hull); empty: none.
  std::function<bool(const cv::Vec3d& point)> possible;
};

// Depth in scene units (0: unknown) and the matching cost in [0, 1] at that depth, both CV_32F at
// the size of the reference.
struct DepthMap {
  cv::Mat depth, cost;
};

DepthMap sweep(const SweepPicture& reference, const std::vector<const SweepPicture*>& others,
               const SweepSettings& settings);

// Step in inverse depth between two planes.
double plane_step(const SweepSettings& settings);

// Number of the maps `others` that agree with the depth of `view` at (x, y) to within `tolerance`
// in inverse depth.
int agreement(const View& view, const DepthMap& map, int x, int y,
              const std::vector<std::pair<const View*, const DepthMap*>>& others, double tolerance);

}  // namespace stgs::encoder::init
