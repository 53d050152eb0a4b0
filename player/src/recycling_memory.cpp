// SPDX-License-Identifier: Apache-2.0
#include "recycling_memory.h"

#include <bit>
#include <limits>

namespace stgs::player {
namespace {

// Smaller blocks are left to the upstream, which seldom returns them to the system.
constexpr std::size_t kMinBytes = 64 << 10;
constexpr std::size_t kAlignment = 64;

bool is_recycled(std::size_t bytes, std::size_t alignment) {
  return bytes >= kMinBytes && bytes <= std::numeric_limits<std::size_t>::max() / 4 &&
         alignment <= kAlignment;
}

// Rounds up to a size of three significant bits, so that blocks of similar segments fit each other.
std::size_t block_size(std::size_t bytes) {
  const std::size_t step = std::bit_floor(bytes) / 4;
  return (bytes + step - 1) / step * step;
}

constexpr std::size_t kKeptBytes = 32 << 20;

}  // namespace

RecyclingMemory& segment_memory() {
  // Never destroyed, because segments may outlive static objects.
  static auto* const memory = new RecyclingMemory(kKeptBytes);
  return *memory;
}

RecyclingMemory::~RecyclingMemory() {
  for (const auto& [bytes, block] : free_) upstream_->deallocate(block, bytes, kAlignment);
}

void* RecyclingMemory::do_allocate(std::size_t bytes, std::size_t alignment) {
  if (!is_recycled(bytes, alignment)) return upstream_->allocate(bytes, alignment);
  const std::size_t size = block_size(bytes);
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = free_.find(size); found != free_.end()) {
      void* const block = found->second;
      free_.erase(found);
      kept_ -= size;
      return block;
    }
  }
  return upstream_->allocate(size, kAlignment);
}

void RecyclingMemory::do_deallocate(void* block, std::size_t bytes, std::size_t alignment) {
  if (!is_recycled(bytes, alignment)) return upstream_->deallocate(block, bytes, alignment);
  const std::size_t size = block_size(bytes);
  {
    const std::lock_guard lock(mutex_);
    if (size <= limit_ - kept_) {
      free_.emplace(size, block);
      kept_ += size;
      return;
    }
  }
  upstream_->deallocate(block, size, kAlignment);
}

}  // namespace stgs::player
