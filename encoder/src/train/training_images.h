// SPDX-License-Identifier: Apache-2.0
// The training frames of a prepared capture, 8 bits a channel, at full and half size: in memory
// where they fit, else decoded from disk ahead of their use.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "train/frame_store.h"

namespace stgs::encoder {

// A camera's frame at level 0, full size, or 1, half size.
struct TrainingView {
  std::size_t camera = 0;  // of TrainingImages::cameras()
  int frame = 0;
  int level = 0;
};

class TrainingImages {
 public:
  // `budget`: bytes of memory for decoded frames; 0: a share of what is available to each of the
  // `processes` on this machine. Where all frames fit they are decoded here; kRuntime where
  // `progress` (stage "load") stops that.
  static Result<TrainingImages> load(const PreparedCapture& capture, std::uint64_t budget,
                                     int processes, const ProgressSink& progress);

  // Training cameras only, in the capture's order.
  const std::vector<Camera>& cameras() const { return cameras_; }
  int frames() const { return frames_; }
  std::size_t views() const { return cameras_.size() * static_cast<std::size_t>(frames_); }
  // The picture of upcoming(0), where upcoming(k) is the view k steps later, as far as is known.
  // The error names the file.
  Result<TrainingImage> next(const std::function<TrainingView(std::uint64_t k)>& upcoming);
  // The camera of a level; near_plane in scene units.
  math::PinholeCamera pinhole(std::size_t camera, int level, float near_plane) const;
  FrameStatistics statistics() const { return store_->statistics(); }

 private:
  std::uint64_t id_of(const TrainingView& view) const;

  std::vector<Camera> cameras_;
  int frames_ = 0;
  std::unique_ptr<FrameStore> store_;
};

}  // namespace stgs::encoder
