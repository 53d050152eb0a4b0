// SPDX-License-Identifier: Apache-2.0
#include "fetch/block_cache.h"

#include <algorithm>
#include <utility>

namespace stgs::player {

bool BlockCache::count(std::uint64_t offset, std::size_t bytes) {
  if (bytes == 0 || bytes > kMaxRead) return false;
  const std::lock_guard lock(mutex_);
  reads_ = std::min(reads_ + 1, kFreeReads + 1);
  return reads_ > kFreeReads && offset / kBlockBytes == (offset + bytes - 1) / kBlockBytes;
}

bool BlockCache::copy(std::uint64_t offset, std::span<std::uint8_t> out) const {
  const std::lock_guard lock(mutex_);
  const auto block = blocks_.find(offset / kBlockBytes * kBlockBytes);
  if (block == blocks_.end()) return false;
  const auto skipped = static_cast<std::size_t>(offset % kBlockBytes);
  const std::vector<std::uint8_t>& bytes = block->second;
  if (skipped > bytes.size() || out.size() > bytes.size() - skipped) return false;
  std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(skipped), out.size(), out.begin());
  return true;
}

std::uint64_t BlockCache::generation() const {
  const std::lock_guard lock(mutex_);
  return generation_;
}

void BlockCache::insert(std::uint64_t begin, std::vector<std::uint8_t> block,
                        std::uint64_t generation) {
  const std::lock_guard lock(mutex_);
  if (generation != generation_) return;
  if (bytes_ + block.size() > kMaxBytes) {
    blocks_.clear();
    bytes_ = 0;
  }
  std::vector<std::uint8_t>& present = blocks_[begin];
  bytes_ += block.size();
  bytes_ -= present.size();
  present = std::move(block);
}

void BlockCache::clear() {
  const std::lock_guard lock(mutex_);
  blocks_.clear();
  bytes_ = 0;
  reads_ = 0;
  ++generation_;
}

}  // namespace stgs::player
