// SPDX-License-Identifier: Apache-2.0
// Vulkan objects of the programs that have a device of their own: stgs play and the tests. The
// functions of volk are those of the device that was opened last.
#pragma once

#include <volk.h>

#include <cstdint>
#include <functional>
#include <span>

#include "stgs/format/status.h"

namespace stgs::tools {

// Returns a zeroed Vulkan structure with its sType.
template <typename T>
T structure(VkStructureType type) {
  T out{};
  out.sType = type;
  return out;
}

// An instance and a device of it, with one queue. Handles that do not exist yet are null.
struct DeviceHandles {
  VkInstance instance = VK_NULL_HANDLE;
  std::uint32_t api_version = VK_API_VERSION_1_1;  // of the instance
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  std::uint32_t queue_family = 0;
};

// Converts a VkResult: kRuntime if the call failed. `action` completes "Vulkan failed while".
inline Status vk_status(VkResult result, const char* action) {
  if (result == VK_SUCCESS) return {};
  return runtime_error("Vulkan failed while {}: VkResult {}", action, static_cast<int>(result));
}

// A mapped, host-visible buffer. The device must outlive it, and must not use it when it is
// destroyed.
class MappedBuffer {
 public:
  MappedBuffer() = default;
  MappedBuffer(const MappedBuffer&) = delete;
  MappedBuffer& operator=(const MappedBuffer&) = delete;
  ~MappedBuffer() { reset(); }

  void reset();
  // Grows the buffer to at least `bytes`. Growing discards its contents.
  Status ensure(const DeviceHandles& device, VkBufferUsageFlags usage, std::uint64_t bytes);
  VkBuffer handle() const { return buffer_; }
  std::uint8_t* data() const { return data_; }

 private:
  VkDevice device_ = VK_NULL_HANDLE;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  std::uint64_t bytes_ = 0;
  std::uint8_t* data_ = nullptr;
};

struct ImageShape {
  VkFormat format = VK_FORMAT_UNDEFINED;
  std::uint32_t width = 0, height = 0;  // pixels
  std::uint32_t levels = 1, layers = 1;
};

// A colour image in device memory. The device must outlive it, and must not use it when it is
// destroyed.
class DeviceImage {
 public:
  DeviceImage() = default;
  DeviceImage(const DeviceImage&) = delete;
  DeviceImage& operator=(const DeviceImage&) = delete;
  ~DeviceImage();

  // Call once.
  Status create(const DeviceHandles& device, const ImageShape& shape, VkImageUsageFlags usage);
  VkImage handle() const { return image_; }

 private:
  VkDevice device_ = VK_NULL_HANDLE;
  VkImage image_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
};

// Returns a barrier for a level of a layer of a colour image, without accesses and layouts.
VkImageMemoryBarrier image_barrier(VkImage image, std::uint32_t level = 0, std::uint32_t layer = 0);
// Returns the region of a copy between a buffer and an image of one level and layer.
VkBufferImageCopy whole_image(std::uint32_t width, std::uint32_t height);
// Creates a view of an image of one level and layer.
Status make_view(VkDevice device, VkImage image, VkFormat format, VkImageView* view);

// A descriptor set with its pool and layout. The device must outlive it, and must not use it when
// it is destroyed.
class DescriptorSet {
 public:
  DescriptorSet() = default;
  DescriptorSet(const DescriptorSet&) = delete;
  DescriptorSet& operator=(const DescriptorSet&) = delete;
  ~DescriptorSet();

  // Call once.
  Status create(VkDevice device, std::span<const VkDescriptorSetLayoutBinding> bindings);
  // Sets the descriptor of a binding: the one of the two that is not null.
  void write(const VkDescriptorSetLayoutBinding& binding, const VkDescriptorImageInfo* image,
             const VkDescriptorBufferInfo* buffer) const;
  const VkDescriptorSetLayout& layout() const { return layout_; }
  const VkDescriptorSet& handle() const { return set_; }

 private:
  VkDevice device_ = VK_NULL_HANDLE;
  VkDescriptorSetLayout layout_ = VK_NULL_HANDLE;
  VkDescriptorPool pool_ = VK_NULL_HANDLE;
  VkDescriptorSet set_ = VK_NULL_HANDLE;
};

// Creates the layout of pipelines with one descriptor set. `push` may be empty.
Status make_pipeline_layout(VkDevice device, const DescriptorSet& set,
                            std::span<const VkPushConstantRange> push, VkPipelineLayout* layout);
Result<VkShaderModule> make_shader(VkDevice device, std::span<const std::uint32_t> code);
// Returns the stage of a pipeline that runs the function main of a shader.
VkPipelineShaderStageCreateInfo stage_of(VkShaderStageFlagBits stage, VkShaderModule module);

// Creates a command pool of the device's queue family with one command buffer.
Status make_commands(const DeviceHandles& device, VkCommandPool* pool, VkCommandBuffer* commands);
// Begins a command buffer that is submitted once.
Status begin_commands(VkCommandBuffer commands);
// Submits the commands that `record` records to the device's queue and waits until it is idle.
Status run_commands(const DeviceHandles& device,
                    const std::function<void(VkCommandBuffer)>& record);

}  // namespace stgs::tools
