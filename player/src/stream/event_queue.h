// SPDX-License-Identifier: Apache-2.0
// What has happened, until it is asked for.
#pragma once

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "stgs/player/player.h"

namespace stgs::player {

// Has its memory from the beginning, so that having none can be told. Not thread-safe.
class EventQueue {
 public:
  EventQueue() { events_.reserve(kMaxEvents); }

  // The oldest makes room for one that is too many.
  void add(PlayerEvent event) noexcept {
    if (events_.size() == kMaxEvents) events_.erase(events_.begin());
    events_.push_back(std::move(event));
  }
  // All, in order; where there is no memory for that none is taken.
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
