// SPDX-License-Identifier: Apache-2.0
// Drawing with Vulkan on a device of the caller's, into images of the caller's. In builds with
// Vulkan (STGS_WITH_VULKAN) alone.
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/player/renderer.h"

namespace stgs::player {

// A device that the caller has made and keeps until the renderer is gone. It needs no feature and
// no extension. Timeline semaphores can be given where it has them. Made with subgroupSizeControl
// and computeFullSubgroups (VulkanSupport::subgroup_size_control), devices whose subgroups vary in
// size draw with the faster shaders, which need to know it.
struct VulkanDevice {
  // Null: that of the Vulkan loader, libvulkan.so.1.
  PFN_vkGetInstanceProcAddr get_instance_proc_addr = nullptr;
  VkInstance instance = VK_NULL_HANDLE;
  // VkApplicationInfo::apiVersion of the instance; it must be 1.1 at least, as the device's.
  std::uint32_t api_version = VK_API_VERSION_1_0;
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  // What was enabled when the device was made; read while the renderer is made. The features with
  // their pNext chain, null where there are none.
  const VkPhysicalDeviceFeatures2* features = nullptr;
  std::vector<std::string> extensions;
  std::uint32_t queue_family = 0;  // one that computes
  VkQueue queue = VK_NULL_HANDLE;  // of the family
  // Called around each use of the queue, from the thread that calls the renderer. Where they are
  // empty nobody else may use the queue during a call. They must not throw.
  std::function<void()> lock_queue, unlock_queue;
};

// One level of one layer of an image, which it fills. The image has VK_IMAGE_USAGE_TRANSFER_DST_BIT
// and optimal tiling; it belongs to the queue's family where it is not shared by families.
struct VulkanImage {
  VkImage image = VK_NULL_HANDLE;
  // Of colour: R8G8B8A8 or B8G8R8A8 as UNORM or SRGB, A2B10G10R10_UNORM_PACK32, R16G16B16A16_SFLOAT
  // or R32G32B32A32_SFLOAT. All get the sRGB-encoded numbers of Frame::colour, with the background,
  // and its alpha: over a black background they are premultiplied. Of depth: R32_SFLOAT.
  VkFormat format = VK_FORMAT_UNDEFINED;
  std::uint32_t width = 0, height = 0;  // of the level, pixels: the view's
  std::uint32_t level = 0, layer = 0;
  VkImageLayout initial_layout = VK_IMAGE_LAYOUT_UNDEFINED;  // in which it is given
  VkImageLayout final_layout = VK_IMAGE_LAYOUT_GENERAL;      // in which it is left
};

struct VulkanTarget {
  VulkanImage colour;
  std::optional<VulkanImage> depth;  // Frame::depth
};

struct VulkanSemaphore {
  VkSemaphore semaphore = VK_NULL_HANDLE;
  std::uint64_t value = 0;  // of a timeline semaphore, > 0; 0: it is a binary one
};

// Where a frame goes, and when.
struct VulkanSubmission {
  std::vector<VulkanTarget> targets;  // one a view
  // The images are not touched before all of `wait`, and ready at `signal`. Without any, in the
  // order of the queue: what was submitted before comes before, what comes later finds them ready.
  std::vector<VulkanSemaphore> wait, signal;
};

// What became of a frame that has ended on the device.
struct VulkanFrame {
  std::uint64_t number = 0;  // submit()'s; 0: none has ended
  // False where it had more splats in tiles than room was known to be needed: it lacks the farthest
  // ones. The frames after it have the room, within what the device can hold.
  bool complete = true;
  RenderStats stats;
};

// As Renderer: one thread at a time. What a frame needs and the device lacks is sent with it; only
// where that is much, as at the beginning, a call waits for it.
class VulkanRenderer : public Renderer {
 public:
  // Frames on their way at most; one more waits until the oldest has ended.
  static constexpr std::size_t kMaxFramesInFlight = 3;

  // Draws 1 to kMaxViews views of a moment into the images of `to` and gives the frame's number,
  // from 1 on, without waiting for it and without bringing pictures to the host: read() has none
  // afterwards. It does wait for earlier frames where there are kMaxFramesInFlight, where buffers
  // grow, and where much is sent first: what their semaphores wait for must be signalled without
  // this thread. Images and semaphores are the caller's and must last until the frame has ended.
  // Errors: those of draw(), of a target or a semaphore (kUsage), and what the device cannot do
  // (kUnsupported); then nothing is submitted: no semaphore is waited for or signalled.
  virtual Result<std::uint64_t> submit(Timeline& timeline, double seconds,
                                       const std::vector<View>& views,
                                       const VulkanSubmission& to) = 0;
  // The latest frame that has ended, without waiting.
  virtual Result<VulkanFrame> last_completed() = 0;
  // Waits until all frames have ended, and so for the semaphores that they wait for. The destructor
  // does.
  virtual Status wait() = 0;
};

// What a physical device is good for, before a device of it is made.
struct VulkanSupport {
  std::string missing_features;  // what it cannot be drawn with for; empty: nothing
  // What a device can be made with, by its version or an extension.
  bool timeline_semaphores = false;
  bool subgroup_size_control = false;  // with computeFullSubgroups
};
// `get_instance_proc_addr` and `api_version` as in VulkanDevice. kUsage where a handle is missing,
// kUnsupported where there is no loader or the instance is of Vulkan 1.0.
Result<VulkanSupport> vulkan_support(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                     VkInstance instance, std::uint32_t api_version,
                                     VkPhysicalDevice physical_device);

// kUsage where a handle is missing or the family does not exist; kUnsupported where the device
// cannot draw, with what it lacks.
Result<std::unique_ptr<VulkanRenderer>> make_vulkan_renderer(const VulkanDevice& device);

}  // namespace stgs::player
