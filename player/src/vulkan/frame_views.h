// SPDX-License-Identifier: Apache-2.0
// The views of a frame: their pictures, and what the shaders are told of them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "stgs/player/vulkan_renderer.h"
#include "vulkan/frame_commands.h"

namespace stgs::player::vulkan {

// Of a view. Frames use it one after the other.
struct Picture {
  int width = 0, height = 0;
  Buffer planes;         // of draw()
  Buffer packed, depth;  // of submit(), for the caller's images

  void set_size(const View& view);
  std::uint64_t pixels() const {
    return static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  }
  std::uint32_t tiles() const;
  std::uint64_t plane_bytes() const;  // with what devices align it by
  std::uint64_t plane_bytes_together() const { return kPlanes * plane_bytes(); }
  // Where it goes: its planes, where `to` is null.
  PictureBuffers buffers(const VulkanTarget* to) const;
};

bool has_fovea(const std::vector<View>& views);

// All but the chunks and the capacity. As many pictures as views, at least.
FrameInput input_of(const std::vector<View>& views, std::span<const Picture> pictures);

}  // namespace stgs::player::vulkan
