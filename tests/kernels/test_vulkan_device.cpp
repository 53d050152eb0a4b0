// SPDX-License-Identifier: Apache-2.0
// Borrowed devices: enabled features, rejected devices, and the locking of their queue.
#include "vulkan/features.h"
#include "vulkan_images.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

TEST_CASE("only features that the device was created with are used") {
  VulkanDevice lent = host().device();
  const VkPhysicalDevice gpu = lent.physical_device;
  const auto supported = vulkan_support(nullptr, lent.instance, lent.api_version, gpu);
  check(supported.status());
  CHECK(vulkan::enabled_features(lent).timeline_semaphores == supported->timeline_semaphores);
  CHECK(vulkan::enabled_features(lent).subgroup_size_control == supported->subgroup_size_control);
  lent.api_version = VK_API_VERSION_1_1;
  lent.extensions.clear();
  CHECK_FALSE(vulkan::enabled_features(lent).timeline_semaphores);
  CHECK_FALSE(vulkan::enabled_features(lent).subgroup_size_control);
  // As core features: both subgroup features are required, in either structure.
  VkPhysicalDeviceVulkan13Features vulkan13{};
  vulkan13.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES;
  VkPhysicalDeviceVulkan12Features vulkan12{};
  vulkan12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
  vulkan12.pNext = &vulkan13;
  VkPhysicalDeviceFeatures2 features{};
  features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
  features.pNext = &vulkan12;
  lent.api_version = VK_API_VERSION_1_3;
  lent.features = &features;
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(gpu, &properties);
  const bool is_1_3 = properties.apiVersion >= VK_API_VERSION_1_3;
  vulkan12.timelineSemaphore = vulkan13.subgroupSizeControl = VK_TRUE;
  CHECK(vulkan::enabled_features(lent).timeline_semaphores);
  CHECK_FALSE(vulkan::enabled_features(lent).subgroup_size_control);
  vulkan13.computeFullSubgroups = VK_TRUE;
  CHECK(vulkan::enabled_features(lent).subgroup_size_control == is_1_3);
  lent.features = nullptr;
  CHECK_FALSE(vulkan::enabled_features(lent).timeline_semaphores);
}

TEST_CASE("a subgroup size is required if the device was created with control of it") {
  const VkPhysicalDevice gpu = host().device().physical_device;
  const vulkan::Features enabled = vulkan::enabled_features(host().device());
  VkPhysicalDeviceSubgroupSizeControlProperties sizes{};
  sizes.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_PROPERTIES;
  VkPhysicalDeviceProperties2 properties{};
  properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
  properties.pNext = &sizes;
  if (enabled.subgroup_size_control) vkGetPhysicalDeviceProperties2(gpu, &properties);
  const auto has = [&](std::uint32_t lanes) {
    return sizes.minSubgroupSize <= lanes && lanes <= sizes.maxSubgroupSize;
  };
  const bool can_require =
      (sizes.requiredSubgroupSizeStages & VK_SHADER_STAGE_COMPUTE_BIT) != 0 && (has(32) || has(16));
  const vulkan::Subgroups subgroups = vulkan::subgroups_of(gpu, enabled);
  CHECK(subgroups.required == can_require);
  if (can_require) CHECK(subgroups.lanes == (has(32) ? 32 : 16));
  CHECK_FALSE(vulkan::subgroups_of(gpu, {}).required);
}

TEST_CASE("an unusable device is rejected with the missing requirement") {
  const auto check_rejected = [](const VulkanDevice& device, StatusCode code, const char* word) {
    const auto renderer = make_vulkan_renderer(device);
    INFO(renderer.status().message());
    CHECK(renderer.status().code() == code);
    CHECK(renderer.status().message().find(word) != std::string::npos);
  };
  check_rejected({}, StatusCode::kUsage, "needs");
  VulkanDevice device = host().device();
  device.queue = VK_NULL_HANDLE;
  check_rejected(device, StatusCode::kUsage, "queue");
  device = host().device();
  device.api_version = VK_API_VERSION_1_0;
  check_rejected(device, StatusCode::kUnsupported, "1.1");
  device = host().device();
  device.queue_family = 99;
  check_rejected(device, StatusCode::kUsage, "family 99");
  device = host().device();
  device.lock_queue = [] {};
  check_rejected(device, StatusCode::kUsage, "lock_queue");
}

TEST_CASE("a device without timeline semaphores renders, and rejects submissions that use them") {
  const auto other = VulkanHost::make(false);
  const auto renderer = renderer_on(*other);
  const auto timeline = make_timeline(random_scene(2000, 0, 60, 4));
  const HostImage image = other->make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  VulkanSubmission submission = submission_to(image);
  submission.wait = {{reinterpret_cast<VkSemaphore>(0x1), 1}};
  const auto number = renderer->submit(*timeline, kSeconds, {make_view()}, submission);
  CHECK(number.status().code() == StatusCode::kUnsupported);
  CHECK(number.status().message().find("timelineSemaphore") != std::string::npos);
  check(renderer->submit(*timeline, kSeconds, {make_view()}, submission_to(image)).status());
  CHECK(psnr(render_on_cpu(*timeline, kSeconds, make_view()), *other, image) >= 50);
}

TEST_CASE("every use of the queue is locked, and the device outlives the renderer") {
  int locked = 0, uses = 0;
  VulkanDevice device = host().device();
  device.get_instance_proc_addr = vkGetInstanceProcAddr;
  device.lock_queue = [&] { ++locked, ++uses; };
  device.unlock_queue = [&] { --locked; };
  const auto timeline = make_timeline(random_scene(2000, 0, 60, 4));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  {
    auto renderer = make_vulkan_renderer(device);
    check(renderer.status());
    check((*renderer)->submit(*timeline, kSeconds, {make_view()}, submission_to(image)).status());
    CHECK(locked == 0);
    CHECK(uses >= 1);
  }
  CHECK(psnr(render_on_cpu(*timeline, kSeconds, make_view()), host(), image) >= 50);
}
