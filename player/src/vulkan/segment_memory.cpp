// SPDX-License-Identifier: Apache-2.0
#include "vulkan/segment_memory.h"

#include <iterator>
#include <utility>

namespace stgs::player::vulkan {

Status SegmentMemory::add_block() {
  Block fresh;
  STGS_TRY(fresh.buffer.create(*device_, block_bytes_, Place::kDevice));
  fresh.free.emplace(0, block_bytes_);
  blocks_.push_back(std::move(fresh));
  return {};
}

void SegmentMemory::reserve(std::uint64_t bytes) {
  const std::size_t before = blocks_.size();
  while (blocks_.size() * block_bytes_ < bytes) {
    if (!add_block().ok()) return blocks_.resize(before);
  }
}

Result<Room> SegmentMemory::take(std::uint64_t bytes) {
  bytes = (bytes + kAlign - 1) / kAlign * kAlign;
  for (std::uint32_t b = 0;; ++b) {
    if (b == blocks_.size()) STGS_TRY(add_block());
    auto& free = blocks_[b].free;
    for (auto hole = free.begin(); hole != free.end(); ++hole) {
      if (hole->second < bytes) continue;
      const Room room{b, hole->first, bytes};
      const std::uint64_t rest = hole->second - bytes;
      free.erase(hole);
      if (rest > 0) free.emplace(room.offset + bytes, rest);
      return room;
    }
  }
}

void SegmentMemory::give_back(const Room& room) {
  auto& free = blocks_[room.block].free;
  auto hole = free.emplace(room.offset, room.bytes).first;
  if (const auto next = std::next(hole);
      next != free.end() && hole->first + hole->second == next->first) {
    hole->second += next->second;
    free.erase(next);
  }
  if (hole == free.begin()) return;
  const auto before = std::prev(hole);
  if (before->first + before->second != hole->first) return;
  before->second += hole->second;
  free.erase(hole);
}

}  // namespace stgs::player::vulkan
