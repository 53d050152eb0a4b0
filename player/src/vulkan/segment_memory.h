// SPDX-License-Identifier: Apache-2.0
// Suballocates device memory for segments: first fit within a few large buffers, each small enough
// for a shader binding.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "vulkan/buffer.h"

namespace stgs::player::vulkan {

// A range of a block.
struct Allocation {
  std::uint32_t block = 0;
  std::uint64_t offset = 0, bytes = 0;
};

class SegmentMemory {
 public:
  static constexpr std::uint64_t kAlign = 16;  // of allocations, bytes

  void create(const Device& device) { device_ = &device; }
  // Sets the size of the blocks that are added from now on, a multiple of kAlign.
  void set_block_bytes(std::uint64_t bytes) { block_bytes_ = bytes; }
  // Adds blocks until they hold `bytes` together; adds none if the device lacks memory for all.
  void reserve(std::uint64_t bytes);
  // Allocates `bytes`: not 0, and at most block_bytes(). kNoMemory if the device is out of memory.
  Result<Allocation> allocate(std::uint64_t bytes);
  void free(const Allocation& allocation);
  std::uint64_t block_bytes() const { return block_bytes_; }
  std::uint32_t blocks() const { return static_cast<std::uint32_t>(blocks_.size()); }
  VkBuffer buffer(std::uint32_t block) const { return blocks_[block].buffer.handle(); }

 private:
  struct Block {
    Buffer buffer;
    std::map<std::uint64_t, std::uint64_t> holes;  // offset, bytes; never adjacent
  };
  Status add_block();

  const Device* device_ = nullptr;
  std::uint64_t block_bytes_ = 0, bytes_ = 0;  // of a new block, of all blocks
  std::vector<Block> blocks_;
};

}  // namespace stgs::player::vulkan
