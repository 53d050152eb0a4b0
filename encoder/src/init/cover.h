// SPDX-License-Identifier: Apache-2.0
// Selects points that cover the image of every view evenly. Overlapping views share points.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// The surface visible in one view.
struct Surface {
  View view;
  cv::Mat rgb;       // 8-bit, at the view's size
  cv::Mat depth;     // CV_32F, scene units, 0: unknown
  cv::Mat weight;    // CV_32F; a pixel can become a point if above 0, larger weights first
  cv::Mat normal{};  // CV_32FC3, world space, 0: unknown; or empty
};

struct SurfacePoint {
  cv::Vec3d position;
  cv::Vec3b colour;
  cv::Vec3f normal{0, 0, 0};  // unit; 0: unknown
};

// Adds one point to `points` for each block of `block` x `block` pixels that has none yet. A point
// counts if its inverse depth differs from that of the surface by at most `tolerance`.
void cover(const std::vector<Surface>& surfaces, int block, double tolerance,
           std::vector<SurfacePoint>* points);

// Calls cover() with the smallest block size, from 2 pixels, that gives at most `limit` points.
// Returns the block size.
int cover_within(const std::vector<Surface>& surfaces, int limit, double tolerance,
                 std::vector<SurfacePoint>* points);

// Returns the initial point of a surface point; frame -1 for a static one.
InitialPoint initial_point(const SurfacePoint& point, const cv::Vec3d& velocity, int frame);

}  // namespace stgs::encoder::init
