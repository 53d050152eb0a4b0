// SPDX-License-Identifier: Apache-2.0
// How a source camera's frames become those of an undistorted, scaled pinhole camera.
#pragma once

#include <opencv2/core.hpp>

#include "frame_reader.h"
#include "source_capture.h"

namespace stgs::encoder {

struct CameraPlan {
  Camera camera;            // what is written
  FrameInfo source;         // what is read
  cv::Mat map_x, map_y;     // where each undistorted pixel comes from; empty: no distortion
  double zoom = 1;          // that undistortion needed to leave no empty border
  bool has_border = false;  // the border stayed beyond the source, and repeats its edge

  // Nothing is done to the frames.
  bool is_identity() const {
    return map_x.empty() && camera.width == source.width && camera.height == source.height;
  }
  // 8-bit pictures of the source's size to such of the camera's.
  cv::Mat frame(const cv::Mat& image) const;
  cv::Mat mask(const cv::Mat& mask) const;  // 0 or 255, nearest neighbour
};

// The new camera keeps the focal lengths and the principal point, times the least zoom of at most
// kMaxUndistortionZoom that leaves no pixel without a source, times `scale` (0, 1]. Error:
// intrinsics for frames of another shape.
inline constexpr double kMaxUndistortionZoom = 1.5;
Result<CameraPlan> plan_camera(const SourceCamera& source, const FrameInfo& info, double scale);

}  // namespace stgs::encoder
