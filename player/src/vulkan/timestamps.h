// SPDX-License-Identifier: Apache-2.0
// Timestamps written by a device.
#pragma once

#include <cstdint>
#include <span>

#include "vulkan/device.h"

namespace stgs::player::vulkan {

// A pool of timestamp queries. One thread. Outlived by the device, which must support timestamps.
class Timestamps {
 public:
  Timestamps() = default;
  Timestamps(const Timestamps&) = delete;
  Timestamps& operator=(const Timestamps&) = delete;
  ~Timestamps();

  static constexpr std::uint32_t kMaxCount = 16;
  Status create(const Device& device, std::uint32_t count);  // at most kMaxCount
  VkQueryPool pool() const { return pool_; }                 // null before create()
  // Returns the milliseconds between successive timestamps, one fewer than there are. The commands
  // that write them must have completed.
  Status between(std::span<double> ms) const;

 private:
  const Device* device_ = nullptr;
  VkQueryPool pool_ = VK_NULL_HANDLE;
  std::uint32_t count_ = 0;
};

}  // namespace stgs::player::vulkan
