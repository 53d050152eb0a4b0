// SPDX-License-Identifier: Apache-2.0
// A queue of player events.
#pragma once

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "stgs/player/player.h"

namespace stgs::player {

// Allocates its memory at construction, so that running out of memory can be reported. Not
// thread-safe.
class EventQueue {
 public:
  EventQueue() { events_.reserve(kMaxEvents); }

  // Appends an event; drops the oldest one if the queue is full.
  void add(PlayerEvent event) noexcept {
    if (events_.size() == kMaxEvents) events_.erase(events_.begin());
    events_.push_back(std::move(event));
  }
  // Removes and returns all events, oldest first. If this throws, all events stay in the queue.
  std::vector<PlayerEvent> take() {
    std::vector<PlayerEvent> out;
    out.reserve(events_.size());
    std::move(events_.begin(), events_.end(), std::back_inserter(out));
    events_.clear();
    return out;
  }

 private:
  std::vector<PlayerEvent> events_;
};

}  // namespace stgs::player
