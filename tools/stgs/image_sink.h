// SPDX-License-Identifier: Apache-2.0
// Destinations of rendered frames, chosen by the name of the output.
#pragma once

#include <memory>
#include <string>

#include "image_io.h"
#include "session.h"
#include "video.h"

namespace stgs::tools {

struct ImageName {
  std::string camera;  // subfolder; may be empty
  int frame = 0;
};

// Receives frames camera by camera, each in the order of time. The output is discarded unless
// finish() succeeds.
class ImageSink {
 public:
  virtual ~ImageSink() = default;
  // Returns which add() to call: 8-bit images (true) or float frames (false).
  virtual bool wants_8bit() const { return true; }
  virtual Status add(const ImageName& name, const encoder::Image8& image) = 0;
  virtual Status add(const ImageName& name, const FloatFrame& frame) = 0;
  virtual Status finish() = 0;
};

// Makes the sink for `output`: a name that ends in .png, .exr, .mp4 or .y4m, "-" (y4m), a folder
// (ends in / or exists) or "null". Checks that it accepts `cameras` x `times` images, and claims it
// for `session`.
Result<std::unique_ptr<ImageSink>> make_image_sink(const std::string& output, TimeBase time_base,
                                                   std::size_t cameras, std::size_t times,
                                                   Session& session);

}  // namespace stgs::tools
