// SPDX-License-Identifier: Apache-2.0
// Video writers: y4m, and mp4 if OpenCV is built in.
#pragma once

#include <memory>
#include <string>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Writes the frames of one video, in order and all of the same size. The output is discarded unless
// finish() succeeds.
class VideoWriter {
 public:
  virtual ~VideoWriter() = default;
  virtual Status add(const encoder::Image8& frame) = 0;
  virtual Status finish() = 0;
};

// YUV4MPEG2: 4:4:4, 8 bits, BT.709 limited range. "-" is standard output.
std::unique_ptr<VideoWriter> make_y4m_writer(const std::string& path, TimeBase time_base);
// Returns why this program cannot write mp4: kNotBuilt without OpenCV.
Status check_mp4_writer();
// H.264 (avc1), or MPEG-4 part 2 (mp4v) with a warning if OpenCV has no H.264 encoder. kNotBuilt
// without OpenCV.
Result<std::unique_ptr<VideoWriter>> make_mp4_writer(const std::string& path, TimeBase time_base,
                                                     const encoder::LogSink& log);

}  // namespace stgs::tools
