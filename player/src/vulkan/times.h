// SPDX-License-Identifier: Apache-2.0
// When a device was so far with its commands.
#pragma once

#include <cstdint>
#include <span>

#include "vulkan/device.h"

namespace stgs::player::vulkan {

// Timestamps. One thread; a device that has them outlives it.
class Times {
 public:
  Times() = default;
  Times(const Times&) = delete;
  Times& operator=(const Times&) = delete;
  ~Times();

  static constexpr std::uint32_t kMost = 16;
  Status create(const Device& device, std::uint32_t count);  // kMost at most
  VkQueryPool pool() const { return pool_; }                 // null before create()
  // Milliseconds from each to the next, one less than there are; what writes them has ended.
  Status between(std::span<double> ms) const;

 private:
  const Device* device_ = nullptr;
  VkQueryPool pool_ = VK_NULL_HANDLE;
  std::uint32_t count_ = 0;
};

}  // namespace stgs::player::vulkan
