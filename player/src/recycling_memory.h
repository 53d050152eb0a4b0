// SPDX-License-Identifier: Apache-2.0
// Memory of decoded segments that is used again.
#pragma once

#include <cstddef>
#include <map>
#include <memory_resource>
#include <mutex>

namespace stgs::player {

// Keeps freed blocks for later allocations of a similar size. A player frees and allocates segments
// all the time; memory that is new to the process costs a third of the time of decoding, because
// the system clears its pages. Threads may share an object, which must outlive its blocks.
class RecyclingMemory final : public std::pmr::memory_resource {
 public:
  // Keeps at most `limit` bytes of free blocks. `upstream` is not owned.
  explicit RecyclingMemory(std::size_t limit,
                           std::pmr::memory_resource* upstream = std::pmr::new_delete_resource())
      : limit_(limit), upstream_(upstream) {}
  RecyclingMemory(const RecyclingMemory&) = delete;
  RecyclingMemory& operator=(const RecyclingMemory&) = delete;
  ~RecyclingMemory() override;

 private:
  void* do_allocate(std::size_t bytes, std::size_t alignment) override;
  void do_deallocate(void* block, std::size_t bytes, std::size_t alignment) override;
  bool do_is_equal(const std::pmr::memory_resource& other) const noexcept override {
    return this == &other;
  }

  const std::size_t limit_;
  std::pmr::memory_resource* const upstream_;
  std::mutex mutex_;
  std::multimap<std::size_t, void*> free_;  // by size
  std::size_t kept_ = 0;                    // bytes of the free blocks
};

// Returns the memory of all players of the process that have no allocator of their own. It exists
// until the process ends, and keeps at most 32 MiB.
RecyclingMemory& segment_memory();

}  // namespace stgs::player
