// SPDX-License-Identifier: Apache-2.0
// Where rendered pictures go; the output's name chooses.
#pragma once

#include <memory>
#include <string>

#include "picture.h"
#include "stgs/encoder/progress.h"
#include "video.h"

namespace stgs::tools {

struct PictureName {
  std::string camera;  // folder; may be empty
  int frame = 0;
};

// Pictures of one camera after the other, in order of time. Nothing remains unless finish()
// succeeds.
class PictureSink {
 public:
  virtual ~PictureSink() = default;
  // Which add() to call: 8-bit pictures, or frames of floats.
  virtual bool wants_8bit() const { return true; }
  virtual Status add(const PictureName& name, const encoder::Image8& picture) = 0;
  virtual Status add(const PictureName& name, const player::Frame& frame) = 0;
  virtual Status finish() = 0;
};

// `output`: a name that ends in .png, .exr, .mp4 or .y4m, "-" (y4m), a folder (ends in / or exists)
// or "null". Checks that it can take `cameras` x `moments` pictures and that it can be written.
Result<std::unique_ptr<PictureSink>> make_picture_sink(const std::string& output,
                                                       TimeBase time_base, std::size_t cameras,
                                                       std::size_t moments,
                                                       const encoder::LogSink& log);

}  // namespace stgs::tools
