// SPDX-License-Identifier: Apache-2.0
// Vulkan helpers of the player window. The functions of volk are those of its one device.
#pragma once

#include <volk.h>

#include <cstdint>

#include "stgs/format/status.h"

namespace stgs::tools {

// Returns a zeroed Vulkan structure with its sType.
template <typename T>
T structure(VkStructureType type) {
  T made{};
  made.sType = type;
  return made;
}

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
  Status ensure(VkPhysicalDevice physical, VkDevice device, VkBufferUsageFlags usage,
                std::uint64_t bytes);
  VkBuffer handle() const { return buffer_; }
  std::uint8_t* data() const { return data_; }

 private:
  VkDevice device_ = VK_NULL_HANDLE;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  std::uint64_t bytes_ = 0;
  std::uint8_t* data_ = nullptr;
};

// Allocates device memory with `properties`. kRuntime if none is left.
Status allocate(VkPhysicalDevice physical, VkDevice device, const VkMemoryRequirements& needs,
                VkMemoryPropertyFlags properties, VkDeviceMemory* memory);

}  // namespace stgs::tools
