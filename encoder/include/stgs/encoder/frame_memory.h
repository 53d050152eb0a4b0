// SPDX-License-Identifier: Apache-2.0
// Frames, masks and initial points of a prepared capture in memory, so that the stages after its
// preparation do not decode them again, or need no files at all.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Thread-safe. Images are immutable once they are added.
class FrameMemory {
 public:
  using ImagePtr = std::shared_ptr<const Image8>;
  struct Points {
    std::vector<InitialPoint> statics, dynamics;
  };

  // Returns the bytes that the frames and masks of these cameras take.
  static std::uint64_t bytes_of(const std::vector<Camera>& cameras, int frames);

  // Frame numbers are those of the capture that this belongs to.
  void add_frame(const std::string& camera, int frame, Image8 image);
  void add_frame(const std::string& camera, int frame, ImagePtr image);
  void add_mask(const std::string& camera, int frame, Image8 mask);
  // Adds the still mask of a camera of a live capture: 255 where only background has been visible
  // for the last seconds.
  void add_still(const std::string& camera, Image8 mask);
  // Return null for an image that was not added.
  ImagePtr frame(const std::string& camera, int frame) const;
  ImagePtr mask(const std::string& camera, int frame) const;
  ImagePtr still(const std::string& camera) const;

  void set_points(Points points);
  // Returns null before set_points().
  std::shared_ptr<const Points> points() const;

 private:
  using Images = std::map<std::pair<std::string, int>, ImagePtr>;

  mutable std::mutex mutex_;
  Images frames_, masks_;
  std::map<std::string, ImagePtr> still_;
  std::shared_ptr<const Points> points_;
};

}  // namespace stgs::encoder
