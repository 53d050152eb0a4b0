// SPDX-License-Identifier: Apache-2.0
// What the steps of a frame take, beside what they cannot do without.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/player/renderer.h"
#include "vulkan/frame_commands.h"

namespace stgs::player::vulkan {

// Timestamps of a device that has them.
class Times {
 public:
  Times() = default;
  Times(const Times&) = delete;
  Times& operator=(const Times&) = delete;
  ~Times();

  Status create(const Device& device, std::uint32_t count);
  VkQueryPool pool() const { return pool_; }
  // Milliseconds from each to the next; what writes them has ended.
  Result<std::vector<double>> between() const;

 private:
  const Device* device_ = nullptr;
  VkQueryPool pool_ = VK_NULL_HANDLE;
  std::uint32_t count_ = 0;
};

// Bytes a second that a copy in the device's memory reads and writes: Vulkan does not tell what the
// memory can do. Waits for the device.
Result<double> copied_bytes_per_second(Device& device);

// Of a frame that has ended: what was counted, and the milliseconds of its steps.
std::vector<RenderStep> steps_of(const FrameWork& work, const Counts& counts,
                                 const std::vector<double>& ms);

}  // namespace stgs::player::vulkan
