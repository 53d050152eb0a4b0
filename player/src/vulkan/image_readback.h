// SPDX-License-Identifier: Apache-2.0
// Copies rendered images to the host.
#pragma once

#include "stgs/player/renderer.h"
#include "vulkan/frame_views.h"

namespace stgs::player::vulkan {

// Retains its host buffer between calls. One thread.
class ImageReadback {
 public:
  // Copies the planes of an image, whose frame must have completed, to `frame`. Waits for the copy.
  Status read(Device& device, const ViewImage& image, Frame& frame);

 private:
  Buffer buffer_;
};

}  // namespace stgs::player::vulkan
