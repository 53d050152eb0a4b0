// SPDX-License-Identifier: Apache-2.0
// Optional features that a Vulkan device supports, and those that it was created with.
#pragma once

#include <volk.h>

#include <cstdint>

#include "stgs/player/vulkan_renderer.h"

namespace stgs::player::vulkan {

// A feature counts as missing if the version is too low and its extension is not available.
struct Features {
  bool timeline_semaphores = false;
  bool subgroup_size_control = false;  // subgroupSizeControl and computeFullSubgroups
};
// Returns the features that a device can be created with, in an instance of the version.
Features offered_features(VkPhysicalDevice device, std::uint32_t api_version);
// Returns the features that the caller's device was created with.
Features enabled_features(const VulkanDevice& lent);

// The distribution of the invocations of a workgroup over subgroups.
struct Subgroups {
  std::uint32_t lanes = 0;  // 16 or 32; 0: unknown
  bool required = false;    // pipelines must request this size and full subgroups
};
// Returns the subgroups of a device that was created with the features. If sizes vary and cannot be
// requested, a workgroup may have more subgroups than its size implies, so the result is unknown.
Subgroups subgroups_of(VkPhysicalDevice device, const Features& enabled);

}  // namespace stgs::player::vulkan
