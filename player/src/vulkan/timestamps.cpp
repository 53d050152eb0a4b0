// SPDX-License-Identifier: Apache-2.0
#include "vulkan/timestamps.h"

#include <array>

namespace stgs::player::vulkan {

Timestamps::~Timestamps() {
  if (device_ != nullptr) device_->vk.vkDestroyQueryPool(device_->handle(), pool_, nullptr);
}

Status Timestamps::create(const Device& device, std::uint32_t count) {
  device_ = &device;
  count_ = count;
  auto info = structure<VkQueryPoolCreateInfo>(VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO);
  info.queryType = VK_QUERY_TYPE_TIMESTAMP;
  info.queryCount = count;
  return vk_status(device.vk.vkCreateQueryPool(device.handle(), &info, nullptr, &pool_),
                   "creating a query pool");
}

Status Timestamps::between(std::span<double> ms) const {
  std::array<std::uint64_t, kMaxCount> at{};
  STGS_TRY(vk_status(
      device_->vk.vkGetQueryPoolResults(device_->handle(), pool_, 0, count_, count_ * sizeof(at[0]),
                                        at.data(), sizeof(at[0]), VK_QUERY_RESULT_64_BIT),
      "reading timestamps"));
  for (std::size_t i = 0; i < ms.size(); ++i) {
    const std::uint64_t increments = (at[i + 1] - at[i]) & device_->timestamp_mask();
    ms[i] = 1e-6 * device_->timestamp_ns() * static_cast<double>(increments);
  }
  return {};
}

}  // namespace stgs::player::vulkan
