// SPDX-License-Identifier: Apache-2.0
// Depth and normals of static images by multi-view stereo.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

struct DepthRange;
struct StaticImage;
struct StereoChoice;

// The depth of one view that stereo confirms.
struct StereoDepth {
  cv::Mat depth;   // CV_32F, scene units; 0: not confirmed
  cv::Mat normal;  // CV_32FC3, world space, unit, faces the camera
  cv::Mat cost;    // CV_32F, in [0, 1]
};

// Matches the images within a depth range. Returns one result per image, at about half its size, or
// none for fewer than three images.
Result<std::vector<StereoDepth>> match_static(const std::vector<StaticImage>& inputs,
                                              const cv::Vec3d& focus, const DepthRange& range,
                                              const StereoChoice& choice, Work& work);

}  // namespace stgs::encoder::init
