// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/frame_memory.h"

namespace stgs::encoder {
namespace {

FrameMemory::ImagePtr find(
    const std::map<std::pair<std::string, int>, FrameMemory::ImagePtr>& images,
    const std::string& camera, int frame) {
  const auto found = images.find({camera, frame});
  return found == images.end() ? nullptr : found->second;
}

}  // namespace

std::uint64_t FrameMemory::bytes_of(const std::vector<Camera>& cameras, int frames) {
  constexpr std::uint64_t kChannels = 3 + 1;  // with the mask
  std::uint64_t pixels = 0;
  for (const Camera& camera : cameras)
    pixels += static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
  return kChannels * pixels * static_cast<std::uint64_t>(frames);
}

void FrameMemory::add_frame(const std::string& camera, int frame, Image8 image) {
  add_frame(camera, frame, std::make_shared<const Image8>(std::move(image)));
}

void FrameMemory::add_frame(const std::string& camera, int frame, ImagePtr image) {
  const std::lock_guard lock(mutex_);
  frames_[{camera, frame}] = std::move(image);
}

void FrameMemory::add_mask(const std::string& camera, int frame, Image8 mask) {
  auto shared = std::make_shared<const Image8>(std::move(mask));
  const std::lock_guard lock(mutex_);
  masks_[{camera, frame}] = std::move(shared);
}

void FrameMemory::add_still(const std::string& camera, Image8 mask) {
  auto shared = std::make_shared<const Image8>(std::move(mask));
  const std::lock_guard lock(mutex_);
  still_[camera] = std::move(shared);
}

FrameMemory::ImagePtr FrameMemory::still(const std::string& camera) const {
  const std::lock_guard lock(mutex_);
  const auto found = still_.find(camera);
  return found == still_.end() ? nullptr : found->second;
}

FrameMemory::ImagePtr FrameMemory::frame(const std::string& camera, int frame) const {
  const std::lock_guard lock(mutex_);
  return find(frames_, camera, frame);
}

FrameMemory::ImagePtr FrameMemory::mask(const std::string& camera, int frame) const {
  const std::lock_guard lock(mutex_);
  return find(masks_, camera, frame);
}

void FrameMemory::set_points(Points points) {
  auto shared = std::make_shared<const Points>(std::move(points));
  const std::lock_guard lock(mutex_);
  points_ = std::move(shared);
}

std::shared_ptr<const FrameMemory::Points> FrameMemory::points() const {
  const std::lock_guard lock(mutex_);
  return points_;
}

}  // namespace stgs::encoder
