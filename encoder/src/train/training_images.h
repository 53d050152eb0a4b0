// SPDX-License-Identifier: Apache-2.0
// The training images of a prepared capture, 8 bits per channel, at full and half size. They reside
// in memory if they fit, else they are decoded from disk ahead of use.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "train/frame_store.h"

namespace stgs::encoder {

// A camera's image at level 0 (full size) or 1 (half size).
struct TrainingView {
  std::size_t camera = 0;  // index into TrainingImages::cameras()
  int frame = 0;
  int level = 0;
};

class TrainingImages {
 public:
  // `budget`: memory for decoded images, bytes; 0: a fraction of the available memory, divided by
  // the `processes` on this machine. Decodes all images if they fit; kRuntime if `progress` (stage
  // "load") cancels. With capture.mask_background, each view has the colour mask_colour_of() there.
  // Views without a frame (has_frame()) are left out; kRuntime if there is no other.
  static Result<TrainingImages> load(const PreparedCapture& capture, std::uint64_t budget,
                                     int processes, const ProgressSink& progress);

  // Returns the training cameras, in the capture's order.
  const std::vector<Camera>& cameras() const { return cameras_; }
  // Replaces the calibrations, which pinhole() uses from now on. The cameras must be the same ones.
  void set_cameras(std::vector<Camera> cameras) { cameras_ = std::move(cameras); }
  int frames() const { return frames_; }
  // Returns the number of views that have a frame.
  std::size_t views() const { return views_.size(); }
  // Returns view `index` of views(), full size.
  TrainingView view(std::size_t index) const {
    const auto frames = static_cast<std::uint32_t>(frames_);
    return {views_[index] / frames, static_cast<int>(views_[index] % frames), 0};
  }
  // Returns the image of upcoming(0). upcoming(k) is the expected view k steps later. The error
  // names the file.
  Result<TrainingImage> next(const std::function<TrainingView(std::uint64_t k)>& upcoming);
  // Returns a camera at a level; near_plane in scene units.
  math::PinholeCamera pinhole(std::size_t camera, int level, float near_plane) const;
  FrameStatistics statistics() const { return store_->statistics(); }

 private:
  void list_views(const PreparedCapture& capture);
  std::uint64_t id_of(const TrainingView& view) const;

  std::vector<Camera> cameras_;
  int frames_ = 0;
  std::vector<std::uint32_t> views_;  // those with a frame, as camera * frames_ + frame, ascending
  std::vector<std::uint32_t> index_;  // of each of them in views_
  std::unique_ptr<FrameStore> store_;
};

}  // namespace stgs::encoder
