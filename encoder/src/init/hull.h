// SPDX-License-Identifier: Apache-2.0
// Visual hull of the dynamic content of one frame (geometry/hull_rule.h).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// The dynamic content of a view, in front of its static surface.
struct Silhouette {
  View view;
  cv::Mat hiding;  // see geometry::VotingView; CV_32F
  bool shows_motion = false;
};
// `mask`: 8-bit, 0: static. `depth`: CV_32F, pixels hide everything beyond it, scene units; 0:
// unknown; or empty: of all pixels. Both have the size of the view.
Silhouette make_silhouette(const View& view, const cv::Mat& mask, const cv::Mat& depth);

// Sets outside[k] to 1 for each point origin + depths[k] * ray that is not in the hull, else to 0.
// Nothing nearer than `nearest`, which is above 0, to a view is in the hull.
void find_outside(const std::vector<Silhouette>& silhouettes, const cv::Vec3d& origin,
                  const cv::Vec3d& ray, const std::vector<float>& depths, double nearest,
                  std::vector<std::uint8_t>* outside);

struct DepthInterval {
  double nearest = 0, farthest = 0;  // scene units
};

// Returns the depths between the limits, which are above 0, at which rays through the masked pixels
// of a box meet the hull, or nothing if none does. Samples the pixels, each at 160 depths that are
// evenly spaced in inverse depth; the interval is one sample larger on each side.
std::optional<DepthInterval> hull_depths(const std::vector<Silhouette>& silhouettes,
                                         const View& view, const cv::Mat& mask, const cv::Rect& box,
                                         const DepthInterval& limits);

}  // namespace stgs::encoder::init
