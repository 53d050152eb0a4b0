// SPDX-License-Identifier: Apache-2.0
// Maps the frames of a source camera to those of an undistorted, scaled pinhole camera.
#pragma once

#include <opencv2/core.hpp>

#include "frame_reader.h"
#include "source_capture.h"

namespace stgs::encoder {

// The largest zoom that undistortion may use to avoid an empty border.
inline constexpr double kMaxUndistortionZoom = 1.5;

struct CameraPlan {
  Camera camera;            // of the prepared frames
  FrameInfo source;         // of the source frames
  cv::Mat map_x, map_y;     // source position of each undistorted pixel; empty: no distortion
  double zoom = 1;          // of the focal lengths, 1 to kMaxUndistortionZoom
  bool has_border = false;  // pixels at the border lie outside the source and repeat its edge

  // Returns true if the frames need no change.
  bool is_identity() const {
    return map_x.empty() && camera.width == source.width && camera.height == source.height;
  }
  // Undistorts and scales an 8-bit source image.
  cv::Mat frame(const cv::Mat& image) const;
  // Undistorts and scales a mask by nearest neighbour. Returns 0 or 255.
  cv::Mat mask(const cv::Mat& mask) const;
};

// Plans the undistortion of one camera. The new camera keeps the principal point and the focal
// lengths, times the smallest zoom that leaves no pixel without a source (1 if that would exceed
// kMaxUndistortionZoom), times `scale` in (0, 1]. kInvalidFile if the intrinsics belong to frames
// of another aspect ratio.
Result<CameraPlan> plan_camera(const SourceCamera& source, const FrameInfo& info, double scale);

}  // namespace stgs::encoder
