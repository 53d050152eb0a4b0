// SPDX-License-Identifier: Apache-2.0
// A program that lends its own Vulkan device, images and semaphores to the renderer.
#pragma once

#include "vulkan_host/host_device.h"

// After volk, which wants to be the first of Vulkan's headers.
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "stgs/player/vulkan_renderer.h"

namespace stgs::testing {

// An image of the host, which outlives it.
struct HostImage {
  VkImage image = VK_NULL_HANDLE;
  VkFormat format = VK_FORMAT_UNDEFINED;
  std::uint32_t width = 0, height = 0;
};

// Ends the program with a message where Vulkan fails.
class VulkanHost {
 public:
  // Null where there is no loader or no device. `features`: made with those that the renderer can
  // use and the device has.
  static std::unique_ptr<VulkanHost> make(bool features);
  ~VulkanHost();
  VulkanHost(const VulkanHost&) = delete;
  VulkanHost& operator=(const VulkanHost&) = delete;

  // As it is lent to the renderer. Its features are valid while the host exists.
  const player::VulkanDevice& device() const { return lent_; }
  bool controls_subgroup_sizes() const { return !device().extensions.empty(); }
  // Messages of the validation layer about all hosts.
  static std::vector<std::string>& messages();

  HostImage make_image(VkFormat format, std::uint32_t width, std::uint32_t height,
                       std::uint32_t levels = 1, std::uint32_t layers = 1);
  // The bytes of a level of a layer, row by row, of an image in `layout`; waits for the queue.
  std::vector<std::uint8_t> read(const HostImage& image, VkImageLayout layout,
                                 std::uint32_t pixel_bytes, std::uint32_t level = 0,
                                 std::uint32_t layer = 0);
  VkSemaphore make_timeline(std::uint64_t value);
  void signal(VkSemaphore semaphore, std::uint64_t value);
  std::uint64_t value_of(VkSemaphore semaphore);

 private:
  VulkanHost() = default;
  // Opens the first device. Returns whether there is one.
  bool open(bool features);

  tools::HostDevice host_;
  player::VulkanDevice lent_;
  std::deque<tools::DeviceImage> images_;
  std::vector<VkSemaphore> semaphores_;
};

// The host of run_vulkan_cases(), one for all cases, because making a host is slow under the
// validation layer.
VulkanHost& host();

// Makes host() and runs the test cases that the arguments select. Prints the messages of the
// validation layer, each of which is a failure. Destroys the host before the program ends: the
// layer cannot be used once its own static objects are destroyed. Returns the exit code, 77
// (skipped) if there is no device.
int run_vulkan_cases(int argc, char** argv);

}  // namespace stgs::testing
