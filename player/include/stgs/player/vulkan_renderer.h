// SPDX-License-Identifier: Apache-2.0
// Renders with Vulkan on a device of the caller, into images of the caller. Only in builds with
// Vulkan (STGS_WITH_VULKAN).
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

// A device that the caller created and that outlives the renderer. No feature and no extension is
// required. Optional:
// - timelineSemaphore, to pass timeline semaphores to VulkanRenderer::submit().
// - subgroupSizeControl and computeFullSubgroups (VulkanSupport::subgroup_size_control), so that
//   devices with varying subgroup sizes use the faster shaders, which require a fixed size.
struct VulkanDevice {
  // Null: vkGetInstanceProcAddr of the Vulkan loader, libvulkan.so.1.
  PFN_vkGetInstanceProcAddr get_instance_proc_addr = nullptr;
  VkInstance instance = VK_NULL_HANDLE;
  // VkApplicationInfo::apiVersion of the instance. The instance and the device must support 1.1.
  std::uint32_t api_version = VK_API_VERSION_1_0;
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  // The features enabled at device creation, with their pNext chain; null: none. Read only while
  // the renderer is created, as are the extensions.
  const VkPhysicalDeviceFeatures2* features = nullptr;
  std::vector<std::string> extensions;  // enabled at device creation
  std::uint32_t queue_family = 0;       // supports compute
  VkQueue queue = VK_NULL_HANDLE;       // of the queue family
  // Called around each use of the queue, on the thread that calls the renderer. Must not throw. If
  // they are empty, nothing else may use the queue during a call.
  std::function<void()> lock_queue, unlock_queue;
};

// One level of one layer of an image, which a view fills completely. The image has optimal tiling
// and VK_IMAGE_USAGE_TRANSFER_DST_BIT, and is owned by the queue family unless it is shared.
struct VulkanImage {
  VkImage image = VK_NULL_HANDLE;
  // Colour: R8G8B8A8 or B8G8R8A8 as UNORM or SRGB, A2B10G10R10_UNORM_PACK32, R16G16B16A16_SFLOAT
  // or R32G32B32A32_SFLOAT. All receive the sRGB-encoded values of Frame::colour, composited with
  // the background, and alpha; over a black background, colours are premultiplied.
  // Depth: R32_SFLOAT.
  VkFormat format = VK_FORMAT_UNDEFINED;
  std::uint32_t width = 0, height = 0;  // of the level, pixels; those of the view
  std::uint32_t level = 0, layer = 0;
  VkImageLayout initial_layout = VK_IMAGE_LAYOUT_UNDEFINED;  // before the frame
  VkImageLayout final_layout = VK_IMAGE_LAYOUT_GENERAL;      // after the frame
};

// Output images of a view.
struct VulkanTarget {
  VulkanImage colour;
  std::optional<VulkanImage> depth;  // as Frame::depth
};

// A binary or timeline semaphore.
struct VulkanSemaphore {
  VkSemaphore semaphore = VK_NULL_HANDLE;
  std::uint64_t value = 0;  // of a timeline semaphore, > 0; 0: the semaphore is binary
};

// Output images of a frame and its synchronisation.
struct VulkanSubmission {
  std::vector<VulkanTarget> targets;  // one per view
  // The images are accessed after all of `wait` and are complete at `signal`. Without semaphores,
  // queue order applies: the frame runs after earlier and before later submissions.
  std::vector<VulkanSemaphore> wait, signal;
};

// A frame that the device has completed.
struct VulkanFrame {
  std::uint64_t number = 0;  // as returned by submit(); 0: no frame has completed
  // False if the splats of the frame touched more tiles than its buffers had capacity for; the
  // farthest ones are missing. Later frames get the capacity, within the limits of the device.
  bool complete = true;
  RenderStats stats;
};

// Renders on a Vulkan device. One thread at a time, as for Renderer. Segments that are missing on
// the device are uploaded with the frame that needs them; a call waits for an upload only if it is
// large, as at the beginning.
class VulkanRenderer : public Renderer {
 public:
  // If this many frames are in flight, submitting another one waits for the oldest.
  static constexpr std::size_t kMaxFramesInFlight = 3;

  // Renders 1 to kMaxViews views at a time of the scene into the images of `to`, and returns the
  // number of the frame, counting from 1. Neither waits for the frame nor copies images to the
  // host: read() returns none afterwards.
  //
  // Waits for earlier frames if kMaxFramesInFlight are in flight, if buffers grow, and if large
  // uploads come first. The semaphores of those frames must therefore be signalled by other
  // threads. Images and semaphores belong to the caller and must outlive the frame.
  //
  // Errors: those of draw(), kUsage for invalid targets or semaphores, kUnsupported for targets
  // that the device cannot write. On error nothing is submitted: no semaphore is waited for or
  // signalled.
  virtual Result<std::uint64_t> submit(Timeline& timeline, double seconds,
                                       const std::vector<View>& views,
                                       const VulkanSubmission& to) = 0;
  // Returns the latest frame that has completed, without waiting.
  virtual Result<VulkanFrame> last_completed() = 0;
  // Blocks until all frames have completed, including the semaphores that they wait for. The
  // destructor does the same.
  virtual Status wait() = 0;
};

// Capabilities of a physical device, available before a device is created.
struct VulkanSupport {
  std::string missing_features;  // the first requirement that is not met; empty: usable
  // Features that a device can be created with, by its version or through an extension.
  bool timeline_semaphores = false;
  bool subgroup_size_control = false;  // with computeFullSubgroups
  // Of several devices, the first with the highest rank renders. 0: not usable.
  int rank = 0;
};
// Queries the capabilities of a physical device. `get_instance_proc_addr` and `api_version` as in
// VulkanDevice. kUsage if a handle is null, kUnsupported if there is no loader or the instance was
// created for Vulkan 1.0.
Result<VulkanSupport> vulkan_support(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                     VkInstance instance, std::uint32_t api_version,
                                     VkPhysicalDevice physical_device);

// Creates a renderer on the caller's device. kUsage if a handle is null or the queue family is
// invalid; kUnsupported if the device does not meet the requirements, which the message names.
Result<std::unique_ptr<VulkanRenderer>> make_vulkan_renderer(const VulkanDevice& device);

}  // namespace stgs::player
