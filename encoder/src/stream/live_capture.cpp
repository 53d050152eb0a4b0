// SPDX-License-Identifier: Apache-2.0
#include "live_capture.h"

#include <algorithm>

#include "half_size.h"
#include "live_controller.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

constexpr int kMinSide = 64;  // pixels; of smaller images, little is left to train on

}  // namespace

int max_halvings(const std::vector<Camera>& cameras) {
  int out = kMaxHalvings;
  for (const Camera& camera : cameras) {
    const int side = std::min(camera.width, camera.height);
    while (out > 0 && side >> out < kMinSide) --out;
  }
  return out;
}

std::uint64_t count_missing(const LiveFrames& frames, const std::vector<std::size_t>& taking_part) {
  std::uint64_t missing = 0;
  for (const LiveFrame& frame : frames.frames)
    for (const std::size_t camera : taking_part) missing += frame.images[camera] ? 0 : 1;
  return missing;
}

PreparedCapture live_capture(const PreparedCapture& rig,
                             const std::vector<std::size_t>& taking_part, const LiveFrames& frames,
                             int halvings) {
  PreparedCapture capture = rig;
  capture.first_frame = frames.first;
  capture.frames = static_cast<int>(frames.frames.size());
  capture.memory = std::make_shared<FrameMemory>();
  for (int h = 0; h < halvings; ++h)
    for (Camera& camera : capture.cameras) camera = half_size(camera);
  const std::size_t cameras = taking_part.size();
  parallel_for(std::size_t{0}, cameras * frames.frames.size(), [&](std::size_t i) {
    const std::size_t frame = i / cameras, camera = i % cameras;
    FrameMemory::ImagePtr image = frames.frames[frame].images[taking_part[camera]];
    if (!image) return;
    for (int h = 0; h < halvings; ++h) image = std::make_shared<const Image8>(half_size(*image));
    capture.memory->add_frame(rig.cameras[camera].name, static_cast<int>(frame), std::move(image));
  });
  return capture;
}

}  // namespace stgs::encoder
