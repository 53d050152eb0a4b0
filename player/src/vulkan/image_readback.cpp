// SPDX-License-Identifier: Apache-2.0
#include "vulkan/image_readback.h"

#include <cstring>

namespace stgs::player::vulkan {

Status ImageReadback::read(Device& device, const ViewImage& image, Frame& frame) {
  const std::uint64_t bytes = image.all_plane_bytes();
  STGS_TRY(buffer_.ensure(device, bytes, MemoryLocation::kHost));
  VkCommandBuffer commands = VK_NULL_HANDLE;
  STGS_TRY(device.begin(&commands));
  const VkBufferCopy region{0, 0, bytes};
  device.vk.vkCmdCopyBuffer(commands, image.planes.handle(), buffer_.handle(), 1, &region);
  barrier(device, commands);
  STGS_TRY(device.finish(commands));
  frame.colour.reshape(image.width, image.height, 3);
  frame.alpha.reshape(image.width, image.height, 1);
  frame.depth.reshape(image.width, image.height, 1);
  const std::uint8_t* from = buffer_.mapped();
  for (Image* out : {&frame.colour, &frame.alpha, &frame.depth}) {
    for (std::size_t at = 0; at < out->data.size(); at += image.pixels()) {
      std::memcpy(out->data.data() + at, from, sizeof(float) * image.pixels());
      from += image.plane_bytes();
    }
  }
  return {};
}

}  // namespace stgs::player::vulkan
