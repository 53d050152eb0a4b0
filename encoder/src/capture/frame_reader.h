// SPDX-License-Identifier: Apache-2.0
// The frames of one camera of a source capture, in order.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "source_capture.h"

namespace stgs::encoder {

struct FrameInfo {
  int width = 0, height = 0;
  int frames = 0;
  double fps = 0;  // 0: pictures, which have no rate
};

// Decodes a picture with cv::imread's flags. Errors: `what` is missing (kIo) or cannot be decoded
// (kInvalidFile), with the path.
Result<cv::Mat> decode_file(const std::string& path, const std::string& what, int flags);

// Looks at the first frame. Errors name file and camera.
Result<FrameInfo> probe_frames(const SourceCamera& camera);

// 8-bit BGR, exactly as stored (no EXIF turning: calibrations and decoders ignore it).
Result<cv::Mat> read_picture(const SourceCamera& camera, int frame, int width, int height);

// Reads a video front to back. Not thread-safe; different readers are independent.
class VideoReader {
 public:
  // Opens the camera's video before frame `first`, by decoding up to it: seeking is not exact.
  static Result<std::unique_ptr<VideoReader>> open(const SourceCamera& camera, int first);
  virtual ~VideoReader() = default;
  // The next frame, 8-bit BGR of width x height.
  virtual Result<cv::Mat> next(int width, int height) = 0;
};

}  // namespace stgs::encoder
