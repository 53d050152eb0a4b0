// SPDX-License-Identifier: Apache-2.0
#include "vulkan/features.h"

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include "frame_layout.h"
#include "vulkan/device.h"

namespace stgs::player::vulkan {
namespace {

bool has_extension(VkPhysicalDevice device, const char* name) {
  std::uint32_t count = 0;
  vkEnumerateDeviceExtensionProperties(device, nullptr, &count, nullptr);
  std::vector<VkExtensionProperties> extensions(count);
  vkEnumerateDeviceExtensionProperties(device, nullptr, &count, extensions.data());
  return std::any_of(extensions.begin(), extensions.end(), [=](const VkExtensionProperties& one) {
    return std::strcmp(one.extensionName, name) == 0;
  });
}

// Returns the lower of the versions of the device and of its instance.
std::uint32_t version_of(VkPhysicalDevice device, std::uint32_t api_version) {
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(device, &properties);
  return std::min(api_version, properties.apiVersion);
}

// Returns the structure of a type in a pNext chain, or null.
template <typename T>
const T* find(const void* chain, VkStructureType type) {
  for (auto* next = static_cast<const VkBaseInStructure*>(chain); next != nullptr;
       next = next->pNext) {
    if (next->sType == type) return reinterpret_cast<const T*>(next);
  }
  return nullptr;
}

bool enables_timeline(const void* chain) {
  const auto* own = find<VkPhysicalDeviceTimelineSemaphoreFeatures>(
      chain, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES);
  const auto* core = find<VkPhysicalDeviceVulkan12Features>(
      chain, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES);
  return (own != nullptr && own->timelineSemaphore == VK_TRUE) ||
         (core != nullptr && core->timelineSemaphore == VK_TRUE);
}

bool enables_subgroup_sizes(const void* chain) {
  const auto* own = find<VkPhysicalDeviceSubgroupSizeControlFeatures>(
      chain, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES);
  const auto* core = find<VkPhysicalDeviceVulkan13Features>(
      chain, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES);
  return (own != nullptr && own->subgroupSizeControl == VK_TRUE &&
          own->computeFullSubgroups == VK_TRUE) ||
         (core != nullptr && core->subgroupSizeControl == VK_TRUE &&
          core->computeFullSubgroups == VK_TRUE);
}

}  // namespace

Features offered_features(VkPhysicalDevice device, std::uint32_t api_version) {
  const std::uint32_t version = version_of(device, api_version);
  auto features =
      structure<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2);
  auto timeline = structure<VkPhysicalDeviceTimelineSemaphoreFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES);
  auto sizes = structure<VkPhysicalDeviceSubgroupSizeControlFeatures>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES);
  if (version >= VK_API_VERSION_1_2 ||
      has_extension(device, VK_KHR_TIMELINE_SEMAPHORE_EXTENSION_NAME)) {
    timeline.pNext = std::exchange(features.pNext, &timeline);
  }
  if (version >= VK_API_VERSION_1_3 ||
      has_extension(device, VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME)) {
    sizes.pNext = std::exchange(features.pNext, &sizes);
  }
  vkGetPhysicalDeviceFeatures2(device, &features);
  return {enables_timeline(features.pNext), enables_subgroup_sizes(features.pNext)};
}

Features enabled_features(const VulkanDevice& lent) {
  const std::uint32_t version = version_of(lent.physical_device, lent.api_version);
  const auto is_available = [&](std::uint32_t core, const char* extension) {
    const auto& names = lent.extensions;
    return version >= core || std::find(names.begin(), names.end(), extension) != names.end();
  };
  return {is_available(VK_API_VERSION_1_2, VK_KHR_TIMELINE_SEMAPHORE_EXTENSION_NAME) &&
              enables_timeline(lent.features),
          is_available(VK_API_VERSION_1_3, VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME) &&
              enables_subgroup_sizes(lent.features)};
}

Subgroups subgroups_of(VkPhysicalDevice device, const Features& enabled) {
  // Without the feature, the sizes are known only through the extension.
  if (!enabled.subgroup_size_control &&
      !has_extension(device, VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME)) {
    return {};
  }
  auto sizes = structure<VkPhysicalDeviceSubgroupSizeControlProperties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_PROPERTIES);
  auto properties =
      structure<VkPhysicalDeviceProperties2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2);
  properties.pNext = &sizes;
  vkGetPhysicalDeviceProperties2(device, &properties);
  const bool compute = (sizes.requiredSubgroupSizeStages & VK_SHADER_STAGE_COMPUTE_BIT) != 0;
  for (const std::uint32_t lanes : {32u, 16u}) {
    if (lanes < sizes.minSubgroupSize || lanes > sizes.maxSubgroupSize) continue;
    if (enabled.subgroup_size_control && compute &&
        sizes.maxComputeWorkgroupSubgroups >= kGroup / lanes) {
      return {lanes, true};
    }
    // If there is only one size, workgroups of a multiple of it consist of full subgroups.
    if (sizes.minSubgroupSize == sizes.maxSubgroupSize) return {lanes, false};
  }
  return {};
}

}  // namespace stgs::player::vulkan
