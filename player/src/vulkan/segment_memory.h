// SPDX-License-Identifier: Apache-2.0
// Memory for segments: a few large buffers, each of which a shader can see as a whole, and first
// fit within them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "vulkan/buffer.h"

namespace stgs::player::vulkan {

struct Room {
  std::uint32_t block = 0;
  std::uint64_t offset = 0, bytes = 0;
};

class SegmentMemory {
 public:
  static constexpr std::uint64_t kAlign = 16;  // of rooms, bytes

  // Blocks of so many bytes, a multiple of kAlign.
  void create(const Device& device, std::uint64_t block_bytes) {
    device_ = &device;
    block_bytes_ = block_bytes;
  }
  // Makes blocks for so many bytes together, where the device has memory for all of them.
  void reserve(std::uint64_t bytes);
  // `bytes` <= block_bytes(), and not 0. kRuntime where the device has no memory left.
  Result<Room> take(std::uint64_t bytes);
  void give_back(const Room& room);
  std::uint64_t block_bytes() const { return block_bytes_; }
  std::uint32_t blocks() const { return static_cast<std::uint32_t>(blocks_.size()); }
  VkBuffer buffer(std::uint32_t block) const { return blocks_[block].buffer.handle(); }

 private:
  struct Block {
    Buffer buffer;
    std::map<std::uint64_t, std::uint64_t> free;  // offset, bytes; never side by side
  };
  Status add_block();

  const Device* device_ = nullptr;
  std::uint64_t block_bytes_ = 0;
  std::vector<Block> blocks_;
};

}  // namespace stgs::player::vulkan
