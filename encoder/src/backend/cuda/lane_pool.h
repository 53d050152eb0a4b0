// SPDX-License-Identifier: Apache-2.0
// A bounded number of lanes: the memory and the stream of a task on a GPU, which later tasks use
// again.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace stgs::encoder::cuda {

// Thread-safe.
template <typename Lane>
class LanePool {
 public:
  // `Lane` is constructed from the number of a GPU.
  LanePool(int gpu, std::size_t max_lanes)
      : LanePool([gpu] { return std::make_unique<Lane>(gpu); }, [max_lanes] { return max_lanes; }) {
  }
  // `max_lanes`: at least 1; if it becomes smaller, lanes that are released are destroyed.
  LanePool(std::function<std::unique_ptr<Lane>()> make, std::function<std::size_t()> max_lanes)
      : make_(std::move(make)), max_lanes_(std::move(max_lanes)) {}

  // Waits for a free lane. The lane returns to the pool, which outlives it, when it is released.
  std::shared_ptr<Lane> take() {
    return {take_free().release(), [this](Lane* used) { give_back(used); }};
  }

 private:
  std::unique_ptr<Lane> take_free() {
    std::unique_lock lock(mutex_);
    returned_.wait(lock, [this] { return !free_.empty() || lanes_ < max_lanes_(); });
    if (free_.empty()) {
      free_.reserve(lanes_ + 1);  // so that returning a lane does not fail
      auto lane = make_();
      ++lanes_;
      return lane;
    }
    std::unique_ptr<Lane> lane = std::move(free_.back());
    free_.pop_back();
    return lane;
  }

  void give_back(Lane* lane) {
    const std::lock_guard lock(mutex_);
    if (lanes_ > max_lanes_()) {
      delete lane;
      --lanes_;
    } else {
      free_.emplace_back(lane);
    }
    returned_.notify_one();
  }

  const std::function<std::unique_ptr<Lane>()> make_;
  const std::function<std::size_t()> max_lanes_;
  std::mutex mutex_;
  std::condition_variable returned_;
  std::vector<std::unique_ptr<Lane>> free_;
  std::size_t lanes_ = 0;
};

}  // namespace stgs::encoder::cuda
