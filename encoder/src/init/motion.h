// SPDX-License-Identifier: Apache-2.0
// What moves: median backgrounds, optical flow, motion masks.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "init/init.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Flow from a frame to the next inside a box of the view, in 1/32 pixels of the view; what is not
// reliable is kNoFlow. Kept small because every frame of every camera has one.
struct FlowPatch {
  static constexpr short kNoFlow = -32768;
  static constexpr double kUnit = 1.0 / 32;
  int step = 1;     // pixels of the view an entry
  cv::Rect box;     // in entries
  cv::Mat vectors;  // CV_16SC2, box.size()

  // True and the flow in pixels at image position (u, v), where it is known.
  bool at(double u, double v, cv::Vec2d* flow) const;
};

// What was learnt about one camera.
struct ViewMotion {
  cv::Mat background;       // 8-bit RGB, temporal median of what does not move
  cv::Mat background_seen;  // 8-bit, 255 where the background was ever seen
  bool given_masks = false;
  std::vector<FlowPatch> flow;  // a frame, the last one is empty
  std::vector<float> coverage;  // share of the mask in the image, a frame
};

// Masks of all frames of `view` are written to the prepared capture where it has none.
// `view` sets the working resolution. Asks `work` between frames whether to go on.
Status find_motion(const PreparedCapture& capture, const View& view, const InitSettings& settings,
                   const Work& work, ViewMotion* motion);

// FOLDER/CAMERA/NNNNNN.flo, NNNNNN being the source's frame counted from 0; "" where `folder` is ""
// or has nothing for the camera. Error: the camera's folder is there, but not the file.
Result<std::string> find_flow(const std::string& folder, const std::string& camera, int frame);

// Reads a Middlebury .flo file: CV_32FC2, pixels. Checks the size that it claims.
Result<cv::Mat> read_flow(const std::string& path);

}  // namespace stgs::encoder::init
