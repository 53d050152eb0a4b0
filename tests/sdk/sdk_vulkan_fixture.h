// SPDX-License-Identifier: Apache-2.0
// A Vulkan device and images owned by the application, into which the C API renders.
#pragma once

#include "vulkan_host.h"

// After volk.h, which must precede other Vulkan headers.
#include <cmath>
#include <memory>
#include <vector>

#include "sdk_fixture.h"
#include "stgs/stgs_vulkan.h"

namespace stgs::testing {

inline constexpr double kTime = 0.4;  // seconds
inline constexpr auto kFinalLayout = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;

inline stgs_vulkan_device device_of(const VulkanHost& owner, bool timeline_semaphores = true) {
  stgs_vulkan_device device;
  REQUIRE(stgs_vulkan_device_defaults(&device, sizeof device) == STGS_OK);
  device.instance = owner.device().instance;
  device.api_version = owner.device().api_version;
  device.physical_device = owner.device().physical_device;
  device.device = owner.device().device;
  device.queue = owner.device().queue;
  device.queue_family = owner.device().queue_family;
  device.timeline_semaphores = timeline_semaphores ? 1 : 0;
  device.subgroup_size_control = owner.controls_subgroup_sizes() ? 1 : 0;
  return device;
}

inline RendererPtr renderer_on(const stgs_vulkan_device& device) {
  stgs_renderer* renderer = nullptr;
  REQUIRE(stgs_vulkan_renderer_create(&device, nullptr, &renderer) == STGS_OK);
  return RendererPtr(renderer);
}

inline stgs_vulkan_target target_of(const HostImage& colour) {
  stgs_vulkan_target target;
  REQUIRE(stgs_vulkan_target_defaults(&target, sizeof target) == STGS_OK);
  target.colour.image = colour.image;
  target.colour.format = colour.format;
  target.colour.width = colour.width;
  target.colour.height = colour.height;
  target.colour.final_layout = kFinalLayout;
  return target;
}

inline stgs_vulkan_frame frame_of(const stgs_view* views, const stgs_vulkan_target* targets,
                                  std::uint32_t count) {
  stgs_vulkan_frame frame;
  REQUIRE(stgs_vulkan_frame_defaults(&frame, sizeof frame) == STGS_OK);
  frame.views = views;
  frame.targets = targets;
  frame.count = count;
  return frame;
}

inline double psnr(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  REQUIRE(a.size() == b.size());
  double squares = 0;
  for (std::size_t i = 0; i < a.size(); ++i) squares += std::pow(a[i] - b[i], 2);
  return -10 * std::log10(squares / (255.0 * 255.0 * static_cast<double>(a.size())) + 1e-20);
}

// PSNR in dB of an image, alpha included, against the CPU renderer.
inline double psnr_against_cpu(stgs_scene* scene, double seconds, const stgs_view& view,
                               VulkanHost& owner, const HostImage& image) {
  return psnr(render_rgba8(cpu_renderer().get(), scene, seconds, view),
              owner.read(image, kFinalLayout, 4));
}

inline HostImage make_rgba8_image(VulkanHost& owner, const stgs_view& view) {
  return owner.make_image(VK_FORMAT_R8G8B8A8_UNORM, view.width, view.height);
}

inline stgs_vulkan_progress progress_of(stgs_renderer* renderer) {
  stgs_vulkan_progress progress{};
  progress.struct_size = sizeof progress;
  REQUIRE(stgs_vulkan_get_progress(renderer, &progress) == STGS_OK);
  return progress;
}

}  // namespace stgs::testing
