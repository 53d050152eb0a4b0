// SPDX-License-Identifier: Apache-2.0
// Computes dense depth of a view against its neighbours: a plane sweep over inverse depth with a
// cost of normalised correlation and colour, smoothed by semi-global matching in four directions.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "geometry/sweep_rule.h"
#include "init/view.h"

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

struct SweepSettings {
  double nearest = 1, farthest = 10;    // depth range, scene units
  int planes = 64;                      // 2..192
  int window = geometry::kSweepWindow;  // pixels, odd
  cv::Rect region;                      // swept part of the reference; empty: all
  cv::Mat mask;                         // 8-bit, 0: no depth is wanted; empty: everywhere
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

// Sweeps the reference against the other views.
DepthMap sweep(const SweepImage& reference, const std::vector<const SweepImage*>& others,
               const SweepSettings& settings);

// Returns the step in inverse depth between adjacent planes.
double plane_step(const SweepSettings& settings);

// Returns the number of maps in `others` that agree with the depth of `view` at (x, y), with an
// inverse depth closer than `tolerance`.
int agreement(const View& view, const DepthMap& map, int x, int y,
              const std::vector<std::pair<const View*, const DepthMap*>>& others, double tolerance);

}  // namespace stgs::encoder::init
