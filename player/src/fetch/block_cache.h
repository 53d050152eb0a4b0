// SPDX-License-Identifier: Apache-2.0
// Blocks of a remote file for reads of few bytes. The index of a file may have pages of 45 bytes in
// any order, each of which would take a request.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <vector>

namespace stgs::player {

// Thread-safe. The first 16 reads of few bytes take a request each, as those of most files do; then
// each block takes one.
class BlockCache {
 public:
  static constexpr std::uint64_t kBlockBytes = 64 << 10;
  static constexpr std::uint64_t kMaxBytes = 32 << 20;  // more are discarded together
  static constexpr std::size_t kMaxRead = 4 << 10;      // reads of more bytes are not cached
  static constexpr int kFreeReads = 16;

  // Counts a read. Returns whether its block is to be used.
  bool count(std::uint64_t offset, std::size_t bytes);
  // Copies bytes of a block to `out`. Returns false if they are not there.
  bool copy(std::uint64_t offset, std::span<std::uint8_t> out) const;
  // Returns a number for insert() that changes with clear().
  std::uint64_t generation() const;
  // Adds a block, which begins at a multiple of kBlockBytes, unless clear() was called since
  // generation().
  void insert(std::uint64_t begin, std::vector<std::uint8_t> block, std::uint64_t generation);
  // Discards all blocks and counts reads from 0, because the file may have changed.
  void clear();

 private:
  mutable std::mutex mutex_;
  std::map<std::uint64_t, std::vector<std::uint8_t>> blocks_;  // by their beginning
  std::uint64_t bytes_ = 0, generation_ = 0;
  int reads_ = 0;
};

}  // namespace stgs::player
