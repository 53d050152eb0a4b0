// SPDX-License-Identifier: Apache-2.0
#include "recycling_memory.h"

#include <catch2/catch.hpp>
#include <cstring>

using stgs::player::RecyclingMemory;

namespace {

// Counts the blocks and bytes that it has given out.
class Counting final : public std::pmr::memory_resource {
 public:
  std::size_t blocks = 0, bytes = 0, allocations = 0;

 private:
  void* do_allocate(std::size_t n, std::size_t alignment) override {
    ++blocks;
    ++allocations;
    bytes += n;
    return std::pmr::new_delete_resource()->allocate(n, alignment);
  }
  void do_deallocate(void* block, std::size_t n, std::size_t alignment) override {
    --blocks;
    bytes -= n;
    std::pmr::new_delete_resource()->deallocate(block, n, alignment);
  }
  bool do_is_equal(const memory_resource& other) const noexcept override { return this == &other; }
};

}  // namespace

TEST_CASE("a freed block is used again for a similar size, and only then") {
  Counting upstream;
  RecyclingMemory memory(8 << 20, &upstream);
  void* const first = memory.allocate(1'000'000);
  memory.deallocate(first, 1'000'000);
  void* const similar = memory.allocate(1'010'000, 16);
  CHECK(similar == first);
  std::memset(similar, 1, 1'010'000);
  void* const larger = memory.allocate(2'000'000);
  CHECK(upstream.allocations == 2);
  memory.deallocate(similar, 1'010'000, 16);
  memory.deallocate(larger, 2'000'000);
  CHECK(upstream.blocks == 2);
}

TEST_CASE("blocks beyond the limit and small blocks are freed, and all of them in the end") {
  Counting upstream;
  {
    RecyclingMemory memory(1 << 20, &upstream);
    void* const a = memory.allocate(700'000);
    void* const b = memory.allocate(700'000);
    void* const small = memory.allocate(100, 8);
    CHECK(upstream.bytes <= 2 * 700'000 * 5 / 4 + 100);
    memory.deallocate(a, 700'000);
    memory.deallocate(b, 700'000);
    memory.deallocate(small, 100, 8);
    CHECK(upstream.blocks == 1);
    CHECK(upstream.bytes <= 1 << 20);
  }
  CHECK(upstream.blocks == 0);
  CHECK(upstream.bytes == 0);
}
