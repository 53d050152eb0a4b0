// SPDX-License-Identifier: Apache-2.0
// Memory of a Vulkan device with an owner.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

#include "vulkan/device.h"

namespace stgs::player::vulkan {

enum class Place {
  kDevice,  // for shaders, transfers and indirect dispatches
  kHost,    // mapped; for transfers
};

// Not while commands that use it run. The device outlives it.
class Buffer {
 public:
  Buffer() = default;
  Buffer(Buffer&& other) noexcept { *this = std::move(other); }
  Buffer& operator=(Buffer&& other) noexcept;
  ~Buffer() { reset(); }

  void reset();
  // Exactly so many bytes, > 0; what it held is lost.
  Status create(const Device& device, std::uint64_t bytes, Place place);
  // At least so many bytes, and a quarter more where it grows, up to `most`.
  Status ensure(const Device& device, std::uint64_t bytes, Place place,
                std::uint64_t most = ~std::uint64_t{0});

  VkBuffer handle() const { return buffer_; }
  std::uint64_t bytes() const { return bytes_; }
  std::uint8_t* mapped() const { return static_cast<std::uint8_t*>(mapped_); }

 private:
  const Device* device_ = nullptr;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  std::uint64_t bytes_ = 0;
  void* mapped_ = nullptr;
};

// All that was commanded before is done and visible to all that follows, the host included.
void barrier(const Device& device, VkCommandBuffer commands);
// What shaders wrote is visible to shaders, and to dispatches that take their size from it. The
// host and copies are left out: for them a device may write back what shaders soon read again.
void shader_barrier(const Device& device, VkCommandBuffer commands);

}  // namespace stgs::player::vulkan
