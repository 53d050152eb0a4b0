// SPDX-License-Identifier: Apache-2.0
// Validates the caller's images and copies rendered images into them.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/player/vulkan_renderer.h"
#include "vulkan/device.h"

namespace stgs::player::vulkan {

// How the blend shaders write pixels of an image format.
struct PixelFormat {
  std::uint32_t pixels = 0;  // kPixel... of frame_layout.h; kPixelPlanes: format not supported
  std::uint32_t bytes = 0;   // per pixel
};
PixelFormat pixel_format(VkFormat format);

// Returns kUsage if targets or semaphores do not match the views, kUnsupported if the device lacks
// a feature that they require.
Status check_submission(const Device& device, const std::vector<View>& views,
                        const VulkanSubmission& to);

// Records a copy of the tightly packed pixels in `from` into an image, with layout transitions.
void copy_to_image(const Device& device, VkBuffer from, const VulkanImage& image,
                   VkCommandBuffer commands);

}  // namespace stgs::player::vulkan
