// SPDX-License-Identifier: Apache-2.0
// The training frames of a prepared capture, 8 bits a channel, resident in memory at full and half
// size.
#pragma once

#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"

namespace stgs::encoder {

class TrainingImages {
 public:
  // Decodes every training frame; refuses, before decoding, what does not fit in memory.
  static Result<TrainingImages> load(const PreparedCapture& capture, const ProgressSink& progress);

  // Training cameras only, in the capture's order.
  const std::vector<Camera>& cameras() const { return cameras_; }
  int frames() const { return frames_; }
  std::size_t views() const { return cameras_.size() * static_cast<std::size_t>(frames_); }
  // level 0: full size, 1: half size.
  const Image8& image(std::size_t camera, int frame, int level) const {
    return images_[level][camera * static_cast<std::size_t>(frames_) + frame];
  }
  // The camera of a level; near_plane in scene units.
  math::PinholeCamera pinhole(std::size_t camera, int level, float near_plane) const;

 private:
  std::vector<Camera> cameras_;
  int frames_ = 0;
  std::vector<Image8> images_[2];
};

}  // namespace stgs::encoder
