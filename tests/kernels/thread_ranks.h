// SPDX-License-Identifier: Apache-2.0
// Ranks as threads of one process, for tests of cooperating ranks.
#pragma once

#include <barrier>
#include <cstdint>
#include <cstring>
#include <functional>
#include <thread>
#include <vector>

#include "stgs/encoder/ranks.h"

namespace stgs::testing {

// State shared by the threads.
struct SharedState {
  explicit SharedState(int ranks)
      : size(ranks), barrier(ranks), blocks(static_cast<std::size_t>(ranks)) {}
  const int size;
  std::barrier<> barrier;
  std::vector<const void*> blocks;
};

class ThreadRanks final : public encoder::Ranks {
 public:
  ThreadRanks(SharedState& shared, int rank) : shared_(shared), rank_(rank) {}
  int rank() const override { return rank_; }
  int size() const override { return shared_.size; }
  int node_rank() const override { return rank_; }
  int node_size() const override { return shared_.size; }
  Status all_gather(const void* own, std::size_t bytes, void* all) override {
    shared_.blocks[static_cast<std::size_t>(rank_)] = own;
    shared_.barrier.arrive_and_wait();
    for (std::size_t r = 0; bytes > 0 && r < shared_.blocks.size(); ++r) {
      std::memcpy(static_cast<std::uint8_t*>(all) + r * bytes, shared_.blocks[r], bytes);
    }
    shared_.barrier.arrive_and_wait();
    return {};
  }
  Status check_peers() override { return {}; }

 private:
  SharedState& shared_;
  const int rank_;
};

// Runs work(ranks) on one thread per rank and joins them.
inline void on_ranks(int size, const std::function<void(encoder::Ranks&)>& work) {
  SharedState shared(size);
  std::vector<std::thread> threads;
  for (int r = 0; r < size; ++r) {
    threads.emplace_back([&shared, &work, r] {
      ThreadRanks ranks(shared, r);
      work(ranks);
    });
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace stgs::testing
