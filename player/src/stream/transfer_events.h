// SPDX-License-Identifier: Apache-2.0
// What transfers met with, until it is asked for.
#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "stgs/player/player.h"
#include "stream/clock_seconds.h"
#include "stream/event_queue.h"
#include "stream/no_memory.h"

namespace stgs::player {

// Thread-safe; to add one does not throw.
class TransferEvents {
 public:
  // Those until opened() go to `on_opening`, where it is set.
  explicit TransferEvents(std::function<void(const PlayerEvent&)> on_opening = {})
      : on_opening_(std::move(on_opening)) {}
  void opened() {
    const std::lock_guard lock(mutex_);
    on_opening_ = nullptr;
  }

  void add(const TransferEvent& event) {
    if (event.kind == TransferEvent::Kind::kFailed) return;  // the pieces tell
    if (event.kind == TransferEvent::Kind::kReplaced) {
      return set_replaced(true, event.message, event.offset);
    }
    put(PlayerEvent::Kind::kRetry, event.offset, event.message);
  }
  // Whether the file is another one now; that is told once as long as it is, and again where nobody
  // has said so for long: what is lost is tried again more often. `now`: seconds of a clock.
  void set_replaced(bool replaced, const std::string& message, std::uint64_t offset = 0,
                    double now = clock_seconds()) {
    {
      const std::lock_guard lock(mutex_);
      const bool before = std::exchange(replaced_, replaced);
      const double last = std::exchange(replaced_at_, replaced ? now : replaced_at_);
      if (!replaced || (before && now - last <= kForgotten)) return;
    }
    put(PlayerEvent::Kind::kReplaced, offset, message);
  }
  std::vector<PlayerEvent> take() {
    const std::lock_guard lock(mutex_);
    return events_.take();
  }

 private:
  static constexpr double kForgotten = 60;  // seconds
  void put(PlayerEvent::Kind kind, std::uint64_t offset, const std::string& message) noexcept {
    PlayerEvent event = event_of(kind, offset, StatusCode::kIo, message);
    const std::lock_guard lock(mutex_);
    if (!on_opening_) return events_.add(std::move(event));
    try {
      on_opening_(event);
    } catch (...) {
      events_.add(std::move(event));  // he has no memory for it now
    }
  }

  std::mutex mutex_;
  std::function<void(const PlayerEvent&)> on_opening_;
  EventQueue events_;
  bool replaced_ = false;
  double replaced_at_ = 0;  // as it was said last, seconds
};

}  // namespace stgs::player
