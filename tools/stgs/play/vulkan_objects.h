// SPDX-License-Identifier: Apache-2.0
// What the window's Vulkan parts share. volk's functions are those of the one device that a window
// has.
#pragma once

#include <volk.h>

#include <cstdint>

#include "stgs/format/status.h"

namespace stgs::tools {

// A zeroed Vulkan structure that says what it is.
template <typename T>
T structure(VkStructureType type) {
  T made{};
  made.sType = type;
  return made;
}

// kRuntime where the call failed.
inline Status vk_status(VkResult result, const char* what) {
  if (result == VK_SUCCESS) return {};
  return runtime_error("Vulkan failed while {}: VkResult {}", what, static_cast<int>(result));
}

// A buffer that the host writes or reads, mapped. The device outlives it; not while it is used.
class MappedBuffer {
 public:
  MappedBuffer() = default;
  MappedBuffer(const MappedBuffer&) = delete;
  MappedBuffer& operator=(const MappedBuffer&) = delete;
  ~MappedBuffer() { reset(); }

  void reset();
  // At least so many bytes; what it held is lost where it grows.
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

// Memory of a kind; kRuntime where there is none left.
Status allocate(VkPhysicalDevice physical, VkDevice device, const VkMemoryRequirements& needs,
                VkMemoryPropertyFlags properties, VkDeviceMemory* memory);

}  // namespace stgs::tools
