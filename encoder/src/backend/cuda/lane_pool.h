// SPDX-License-Identifier: Apache-2.0
// A bounded number of lanes: the memory and the stream of a task on a GPU, which later tasks use
// again.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <memory>
#include <mutex>
#include <vector>

namespace stgs::encoder::cuda {

// Thread-safe. `Lane` is constructed from the number of a GPU.
template <typename Lane>
class LanePool {
 public:
  LanePool(int gpu, std::size_t max_lanes) : gpu_(gpu), max_lanes_(max_lanes) {
    free_.reserve(max_lanes);
  }

  // Waits for a free lane. The lane returns to the pool, which outlives it, when it is released.
  std::shared_ptr<Lane> take() {
    return {take_free().release(), [this](Lane* used) { give_back(used); }};
  }

 private:
  std::unique_ptr<Lane> take_free() {
    std::unique_lock lock(mutex_);
    returned_.wait(lock, [this] { return !free_.empty() || lanes_ < max_lanes_; });
    if (free_.empty()) {
      auto lane = std::make_unique<Lane>(gpu_);
      ++lanes_;
      return lane;
    }
    std::unique_ptr<Lane> lane = std::move(free_.back());
    free_.pop_back();
    return lane;
  }

  void give_back(Lane* lane) {
    const std::lock_guard lock(mutex_);
    free_.emplace_back(lane);
    returned_.notify_one();
  }

  const int gpu_;
  const std::size_t max_lanes_;
  std::mutex mutex_;
  std::condition_variable returned_;
  std::vector<std::unique_ptr<Lane>> free_;
  std::size_t lanes_ = 0;
};

}  // namespace stgs::encoder::cuda
