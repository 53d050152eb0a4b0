// SPDX-License-Identifier: Apache-2.0
// Detects dynamic content: median backgrounds, optical flow and motion masks.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "geometry/motion_finder.h"
#include "geometry/motion_rule.h"
#include "init/init.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Flow from a frame to the next inside a box of the view, in units of kUnit. Unreliable entries are
// kNoFlow. Compact, because every frame of every camera has one.
struct FlowPatch {
  static constexpr short kNoFlow = geometry::kUnknownFlow;
  static constexpr double kUnit = 1.0 / geometry::kFlowUnits;  // pixels
  int step = 1;                                                // pixels of the view per entry
  cv::Rect box;                                                // in units of entries
  cv::Mat vectors;                                             // CV_16SC2, box.size()

  // Sets `flow` to the flow in pixels at image position (u, v). Returns false where it is unknown.
  bool at(double u, double v, cv::Vec2d* flow) const;
};

// The motion of one camera.
struct ViewMotion {
  cv::Mat background;        // 8-bit RGB, temporal median of the static content
  cv::Mat background_valid;  // 8-bit, 255 where the background is known
  bool given_masks = false;
  std::vector<FlowPatch> flow;         // per frame; the last is empty, as those not found yet
  std::vector<std::uint8_t> has_flow;  // per frame, whether `flow` was found
  std::vector<float> coverage;         // fraction of masked pixels, per frame
};

inline constexpr int kFlowStep = 2;  // FlowPatch::step of flow that is found
// Returns FlowPatch::box of a mask, for this step.
cv::Rect packed_box(const cv::Mat& mask);

// Returns 255 where flow (CV_32FC2, pixels) is known and clearly longer than that of static pixels,
// else 0.
cv::Mat moving_by_flow(const cv::Mat& flow);

// Detects the motion of one camera. Writes the masks of all frames to the prepared capture if it
// has none for the camera. `view` sets the working resolution; `gpu` is null for the CPU. Checks
// `work` for cancellation between frames.
Status find_motion(const PreparedCapture& capture, const View& view, const InitSettings& settings,
                   geometry::MotionFinder* gpu, const Work& work, ViewMotion* motion);

// Receives the mask of a frame, at the size of the view.
using MaskSink = std::function<Status(int frame, const cv::Mat& mask)>;

// The same for a window of a live capture, by its background alone: there is no flow. Only frames
// with dynamic points (point_frames.h) get masks. The background then learns from the window.
Status find_live_motion(const PreparedCapture& capture, const View& view,
                        const InitSettings& settings, geometry::MotionFinder* gpu, const Work& work,
                        ViewMotion* motion);

// Finds the flow from a frame before the last to the next, unless it was found. Concurrent calls
// need different frames or cameras. Detecting the motion of a camera with given masks leaves it
// out, because it takes long and only velocities use it.
Status find_frame_flow(const PreparedCapture& capture, const View& view,
                       const InitSettings& settings, geometry::MotionFinder* gpu, int frame,
                       ViewMotion* motion);

// Returns the flow that was given for a frame, at the size of the view: CV_32FC2, pixels. Empty if
// the camera has none.
Result<cv::Mat> given_flow(const PreparedCapture& capture, const View& view,
                           const InitSettings& settings, int frame);

// Returns the path FOLDER/CAMERA/NNNNNN.flo, where NNNNNN is the source frame, counted from 0.
// `folder` lies in the capture of `files`. Empty if it has no folder of the camera. kIo if only the
// file is missing.
Result<std::string> find_flow(const CaptureFolder& files, const std::string& folder,
                              const std::string& camera, int frame);

// Reads a Middlebury .flo file: CV_32FC2, pixels. kInvalidFile for a wrong size or a truncated
// file.
Result<cv::Mat> read_flow(const CaptureFolder& files, const std::string& path);

}  // namespace stgs::encoder::init
