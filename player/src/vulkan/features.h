// SPDX-License-Identifier: Apache-2.0
// What a Vulkan device can be made with, and what it was made with.
#pragma once

#include <volk.h>

#include <cstdint>

#include "stgs/player/vulkan_renderer.h"

namespace stgs::player::vulkan {

// All are as good as missing where the version is too low and the extension is not there.
struct Features {
  bool timeline_semaphores = false;
  // subgroupSizeControl and computeFullSubgroups.
  bool subgroup_size_control = false;
};
// That a device of the physical one can be made with, in an instance of the version.
Features offered_features(VkPhysicalDevice device, std::uint32_t api_version);
// That the caller's was made with.
Features enabled_features(const VulkanDevice& lent);

// How the invocations of a workgroup are in subgroups.
struct Subgroups {
  std::uint32_t lanes = 0;  // 16 or 32; 0: neither is known
  bool required = false;    // pipelines must ask for it, and for full ones; false: all have it
};
// Of a device that was made with them or without. Where sizes vary and none can be asked for, the
// invocations of a workgroup may be in more subgroups than their size tells.
Subgroups subgroups_of(VkPhysicalDevice device, const Features& enabled);

}  // namespace stgs::player::vulkan
