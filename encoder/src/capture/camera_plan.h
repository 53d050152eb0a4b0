// SPDX-License-Identifier: Apache-2.0
// Maps the frames of a source camera to those of an undistorted, scaled pinhole camera.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "frame_reader.h"
#include "geometry/frame_warp.h"
#include "source_capture.h"

namespace stgs::encoder {

// The largest zoom that undistortion may use to avoid an empty border.
inline constexpr double kMaxUndistortionZoom = 1.5;

struct CameraPlan {
  Camera camera;     // of the prepared frames
  FrameInfo source;  // of the source frames
  LensModel lens = LensModel::kPinhole;
  std::vector<double> distortion;  // as in SourceCamera
  // Intrinsics of the source frames and of the undistorted ones before they are scaled, in OpenCV's
  // convention, with pixel centres at integers.
  cv::Matx33d from, to;
  double zoom = 1;          // of the focal lengths, 1 to kMaxUndistortionZoom
  bool has_border = false;  // pixels at the border lie outside the source and repeat its edge

  // Returns true if the frames need no change.
  bool is_identity() const {
    return lens == LensModel::kPinhole && camera.width == source.width &&
           camera.height == source.height;
  }
};

// The device that undistorts and scales frames.
struct MappingDevice {
  std::shared_ptr<geometry::FrameWarper> gpu;  // null: the CPU
  // A camera that does not fit into the memory of the GPU is an error. Otherwise the CPU changes
  // its frames, which is logged.
  bool required = false;
  LogSink log;
};

// Follows settings.backend: "cpu", "cuda", or "auto", which is CUDA if it can be used. Errors as
// geometry::make_frame_warper().
Result<MappingDevice> choose_mapping_device(const PrepareSettings& settings, const LogSink& log);

// Changes the frames of a camera as planned, on the CPU or on a GPU. With lens distortion it has 8
// bytes per pixel of a source frame, on the GPU too: keep it only while the frames of the camera
// are written. Thread-safe.
class FrameMapping {
 public:
  // `plan` and the GPU of the device must outlive the object.
  static Result<std::unique_ptr<FrameMapping>> make(const CameraPlan& plan,
                                                    const MappingDevice& mapping_device);
  // On the CPU.
  explicit FrameMapping(const CameraPlan& plan);

  bool is_on_gpu() const { return warp_ != nullptr; }
  // Undistorts and scales an 8-bit source image of 3 or 4 channels. A GPU leaves out the fourth.
  // kRuntime if the GPU fails.
  Result<cv::Mat> frame(const cv::Mat& image) const;
  // The same for a frame of a video, which becomes BGR. Only on a GPU.
  Result<cv::Mat> frame(const geometry::YuvFrame& frame) const;
  // Undistorts and scales a mask by nearest neighbour. Returns 0 or 255.
  cv::Mat mask(const cv::Mat& mask) const;
  // Source positions of the undistorted pixels, CV_32FC1; empty without distortion.
  const cv::Mat& map_x() const { return map_x_; }
  const cv::Mat& map_y() const { return map_y_; }

 private:
  cv::Mat on_cpu(const cv::Mat& image) const;
  template <typename Source>
  Result<cv::Mat> on_gpu(const Source& source) const;

  const CameraPlan& plan_;
  cv::Mat map_x_, map_y_;
  std::unique_ptr<geometry::FrameWarp> warp_;  // null: on the CPU
};

// Plans the undistortion of one camera. The new camera keeps the principal point and the focal
// lengths, times the smallest zoom that leaves no pixel without a source (1 if that would exceed
// kMaxUndistortionZoom), times `scale` in (0, 1]. kInvalidFile if the intrinsics belong to frames
// of another aspect ratio.
Result<CameraPlan> plan_camera(const SourceCamera& source, const FrameInfo& info, double scale);

}  // namespace stgs::encoder
