// SPDX-License-Identifier: Apache-2.0
// Converts, undistorts and scales frames on a GPU. The reference on the CPU is FrameMapping
// (capture/camera_plan.h) after FrameConverter (capture/frame_converter.h): conversion and
// undistortion are equal, scaled values differ by at most 1.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "geometry/warp_rule.h"
#include "stgs/format/status.h"

namespace stgs::encoder::geometry {

// The colours of a video and its taps (warp_tables.h).
struct YuvRule {
  YuvCoefficients coefficients{};
  std::vector<ChromaTaps> columns, rows;
};

// A decoded frame of a video.
struct YuvFrame {
  YuvPlanes planes{};
  bool on_device = false;  // the planes are written on CUDA's default stream
  int quarters = 0;        // of a turn, clockwise, by which the frame is rotated
  std::shared_ptr<const YuvRule> rule;
};

// How the frames of a camera change: they are undistorted, then scaled.
struct WarpCamera {
  int source_width = 0, source_height = 0;  // pixels, after rotation
  int width = 0, height = 0;                // of the result, not larger
  // Source positions of the undistorted pixels, source_width x source_height, with integer pixel
  // centres, of host memory; null: no distortion.
  const float* map_x = nullptr;
  const float* map_y = nullptr;
};

// Of one camera. Thread-safe. Errors: kRuntime if the GPU fails.
class FrameWarp {
 public:
  virtual ~FrameWarp() = default;
  // Writes the result to host memory, width x height x 3 bytes, as BGR. Waits for it.
  virtual Status run(const YuvFrame& frame, std::uint8_t* out) const = 0;
  // The same for an image of host memory, in its order of channels. Only for cameras whose frames
  // change.
  virtual Status run(const PackedImage& image, std::uint8_t* out) const = 0;
};

// Outlives its warps. Thread-safe.
class FrameWarper {
 public:
  virtual ~FrameWarper() = default;
  // All cameras together get a quarter of the GPU memory that was free when the object was made.
  // kNoMemory if the camera needs more than is left, kRuntime if the GPU fails.
  virtual Result<std::unique_ptr<FrameWarp>> make(const WarpCamera& camera) = 0;
};

// On GPU number `gpu` modulo the number of GPUs. kNotBuilt without CUDA, kUnsupported without one.
Result<std::unique_ptr<FrameWarper>> make_cuda_frame_warper(int gpu);

}  // namespace stgs::encoder::geometry
