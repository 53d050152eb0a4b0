// SPDX-License-Identifier: Apache-2.0
// Owned buffers in Vulkan device or host memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

#include "vulkan/device.h"

namespace stgs::player::vulkan {

enum class MemoryLocation {
  kDevice,    // device-local, for shaders, transfers and indirect dispatches
  kSegments,  // as kDevice, for segments, which DeviceSegments charges
  kHost,      // host-visible and mapped, for transfers
};

// A buffer with its own memory. Must not change while commands that use it are executing. The
// device outlives it.
class Buffer {
 public:
  Buffer() = default;
  Buffer(Buffer&& other) noexcept { *this = std::move(other); }
  Buffer& operator=(Buffer&& other) noexcept;
  ~Buffer() { reset(); }

  void reset();
  // Allocates exactly `bytes`, greater than 0. The contents are undefined. kNoMemory if the device
  // is out of memory, kLimit if Device::renderer_memory is exceeded.
  Status create(const Device& device, std::uint64_t bytes, MemoryLocation location);
  // Allocates at least `bytes`; if it grows, a quarter more, up to `max_bytes`.
  Status ensure(const Device& device, std::uint64_t bytes, MemoryLocation location,
                std::uint64_t max_bytes = ~std::uint64_t{0});

  VkBuffer handle() const { return buffer_; }
  std::uint64_t bytes() const { return bytes_; }
  std::uint8_t* mapped() const { return static_cast<std::uint8_t*>(mapped_); }

 private:
  const Device* device_ = nullptr;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  std::uint64_t bytes_ = 0, charged_ = 0;
  void* mapped_ = nullptr;
};

// Records a barrier: all earlier commands complete and are visible to later ones and to the host.
void barrier(const Device& device, VkCommandBuffer commands);
// Records a barrier: shader writes are visible to shaders and to indirect dispatches. Excludes the
// host and copies, for which a device may write back data that shaders read again soon.
void shader_barrier(const Device& device, VkCommandBuffer commands);

}  // namespace stgs::player::vulkan
