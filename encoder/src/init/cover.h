// SPDX-License-Identifier: Apache-2.0
// Points chosen so that every view's picture is evenly covered: views share what they both see.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// What a view knows about the surface that it sees.
struct Surface {
  View view;
  cv::Mat rgb;     // 8-bit, at the view's size
  cv::Mat depth;   // CV_32F, scene units, 0: unknown
  cv::Mat weight;  // CV_32F; a pixel becomes a point only where it is above 0, the largest first
};

struct SurfacePoint {
  cv::Vec3d position;
  cv::Vec3b colour;
};

// Adds to `points` (which count as there already) one for each block of `block` x `block` pixels
// in which no point lies at the surface's depth to within `tolerance` in inverse depth.
void cover(const std::vector<Surface>& surfaces, int block, double tolerance,
           std::vector<SurfacePoint>* points);

// cover() with the smallest block that leaves at most `limit` points. Returns that block.
int cover_within(const std::vector<Surface>& surfaces, int limit, double tolerance,
                 std::vector<SurfacePoint>* points);

}  // namespace stgs::encoder::init
