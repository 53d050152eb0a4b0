// SPDX-License-Identifier: Apache-2.0
#include "vulkan/segment_memory.h"

#include <iterator>
#include <utility>

namespace stgs::player::vulkan {

Status SegmentMemory::add_block() {
  Block fresh;
  STGS_TRY(fresh.buffer.create(*device_, block_bytes_, MemoryLocation::kSegments));
  fresh.holes.emplace(0, block_bytes_);
  blocks_.push_back(std::move(fresh));
  bytes_ += block_bytes_;
  return {};
}

void SegmentMemory::reserve(std::uint64_t bytes) {
  const std::size_t before = blocks_.size();
  const std::uint64_t bytes_before = bytes_;
  while (bytes_ < bytes) {
    if (add_block().ok()) continue;
    blocks_.resize(before);
    bytes_ = bytes_before;
    return;
  }
}

Result<Allocation> SegmentMemory::allocate(std::uint64_t bytes) {
  bytes = (bytes + kAlign - 1) / kAlign * kAlign;
  for (std::uint32_t b = 0;; ++b) {
    if (b == blocks_.size()) STGS_TRY(add_block());
    auto& holes = blocks_[b].holes;
    for (auto hole = holes.begin(); hole != holes.end(); ++hole) {
      if (hole->second < bytes) continue;
      const Allocation allocation{b, hole->first, bytes};
      const std::uint64_t rest = hole->second - bytes;
      holes.erase(hole);
      if (rest > 0) holes.emplace(allocation.offset + bytes, rest);
      return allocation;
    }
  }
}

void SegmentMemory::free(const Allocation& allocation) {
  auto& holes = blocks_[allocation.block].holes;
  auto hole = holes.emplace(allocation.offset, allocation.bytes).first;
  if (const auto next = std::next(hole);
      next != holes.end() && hole->first + hole->second == next->first) {
    hole->second += next->second;
    holes.erase(next);
  }
  if (hole == holes.begin()) return;
  const auto before = std::prev(hole);
  if (before->first + before->second != hole->first) return;
  before->second += hole->second;
  holes.erase(hole);
}

}  // namespace stgs::player::vulkan
