// SPDX-License-Identifier: Apache-2.0
// Ranks that are threads of one process, for tests of what several do together.
#pragma once

#include <barrier>
#include <cstdint>
#include <cstring>
#include <functional>
#include <thread>
#include <vector>

#include "stgs/encoder/ranks.h"

namespace stgs::testing {

// What the threads share.
struct Table {
  explicit Table(int ranks)
      : size(ranks), together(ranks), given(static_cast<std::size_t>(ranks)) {}
  const int size;
  std::barrier<> together;
  std::vector<const void*> given;
};

class ThreadRanks final : public encoder::Ranks {
 public:
  ThreadRanks(Table& table, int rank) : table_(table), rank_(rank) {}
  int rank() const override { return rank_; }
  int size() const override { return table_.size; }
  int node_rank() const override { return rank_; }
  int node_size() const override { return table_.size; }
  Status all_gather(const void* own, std::size_t bytes, void* all) override {
    table_.given[static_cast<std::size_t>(rank_)] = own;
    table_.together.arrive_and_wait();
    for (std::size_t r = 0; bytes > 0 && r < table_.given.size(); ++r) {
      std::memcpy(static_cast<std::uint8_t*>(all) + r * bytes, table_.given[r], bytes);
    }
    table_.together.arrive_and_wait();
    return {};
  }
  Status check_peers() override { return {}; }

 private:
  Table& table_;
  const int rank_;
};

// work(ranks) on a thread for each rank.
inline void on_ranks(int size, const std::function<void(encoder::Ranks&)>& work) {
  Table table(size);
  std::vector<std::thread> threads;
  for (int r = 0; r < size; ++r) {
    threads.emplace_back([&table, &work, r] {
      ThreadRanks ranks(table, r);
      work(ranks);
    });
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace stgs::testing
