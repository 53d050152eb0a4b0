// SPDX-License-Identifier: Apache-2.0
// Moving pictures out: y4m, and mp4 where OpenCV is built in.
#pragma once

#include <memory>
#include <string>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Takes the frames of one video in order, all of one size. What was written vanishes unless
// finish() succeeds.
class VideoWriter {
 public:
  virtual ~VideoWriter() = default;
  virtual Status add(const encoder::Image8& picture) = 0;
  virtual Status finish() = 0;
};

// YUV4MPEG2, 4:4:4, 8 bits, BT.709 limited range; "-" is standard output.
std::unique_ptr<VideoWriter> make_y4m_writer(const std::string& path, TimeBase time_base);
// H.264 (avc1); says so in the log where only MPEG-4 part 2 (mp4v) is available. kNotBuilt without
// OpenCV.
Result<std::unique_ptr<VideoWriter>> make_mp4_writer(const std::string& path, TimeBase time_base,
                                                     const encoder::LogSink& log);

}  // namespace stgs::tools
