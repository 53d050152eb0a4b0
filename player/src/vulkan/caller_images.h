// SPDX-License-Identifier: Apache-2.0
// The caller's images: what they may be, and bringing pictures into them.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/player/vulkan_renderer.h"
#include "vulkan/device.h"

namespace stgs::player::vulkan {

// How the blend writes pixels for a format.
struct PixelFormat {
  std::uint32_t pixels = 0;  // kPixel... ; kPixelPlanes: for none
  std::uint32_t bytes = 0;   // of a pixel
};
PixelFormat pixel_format(VkFormat format);

// kUsage where targets and semaphores do not fit the views, kUnsupported where the device lacks
// what they need.
Status check_submission(const Device& device, const std::vector<View>& views,
                        const VulkanSubmission& to);

// Copies a picture that lies in `from`, row by row, into an image.
void copy_picture(const Device& device, VkBuffer from, const VulkanImage& image,
                  VkCommandBuffer commands);

}  // namespace stgs::player::vulkan
