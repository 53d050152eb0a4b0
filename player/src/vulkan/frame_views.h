// SPDX-License-Identifier: Apache-2.0
// The views of a frame: their image buffers and the shader input.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "stgs/player/vulkan_renderer.h"
#include "vulkan/frame_commands.h"

namespace stgs::player::vulkan {

// The image of a view. Frames use it one after the other.
struct ViewImage {
  int width = 0, height = 0;
  Buffer planes;         // for draw()
  Buffer packed, depth;  // for submit(), copied to the caller's images

  void set_size(const View& view);
  std::uint64_t pixels() const {
    return static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  }
  std::uint32_t tiles() const;
  std::uint64_t plane_bytes() const;  // with alignment
  std::uint64_t all_plane_bytes() const { return kPlanes * plane_bytes(); }
  // Returns the output buffers for a target; null: the planes.
  ImageBuffers buffers(const VulkanTarget* to) const;
};

// Grows the buffers of the images: those of the targets, or the planes if `to` is null. Calls
// `wait` first, which waits for the frames in flight, since they use the buffers.
Status grow_images(const Device& device, std::span<ViewImage> images, const VulkanSubmission* to,
                   const std::function<Status()>& wait);

bool has_fovea(const std::vector<View>& views);

// Returns the shader input, except chunks and capacity. `images` has at least one element per view.
FrameInput input_of(const std::vector<View>& views, std::span<const ViewImage> images);

}  // namespace stgs::player::vulkan
