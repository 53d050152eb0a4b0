// SPDX-License-Identifier: Apache-2.0
// Collects the events of transfers.
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

// Thread-safe. Adding events does not throw.
class TransferEvents {
 public:
  // Events before opened() go to `on_opening`, if it is set.
  explicit TransferEvents(std::function<void(const PlayerEvent&)> on_opening = {})
      : on_opening_(std::move(on_opening)) {}
  // Ends the opening phase: later events are queued for take().
  void opened() {
    const std::lock_guard lock(mutex_);
    on_opening_ = nullptr;
  }

  // Adds the event of a transfer.
  void add(const TransferEvent& event) {
    if (event.kind == TransferEvent::Kind::kFailed) return;  // reported for each segment layer
    if (event.kind == TransferEvent::Kind::kReplaced) {
      return set_replaced(true, event.message, event.offset);
    }
    push(PlayerEvent::Kind::kRetry, event.offset, event.message);
  }
  // Sets whether the file is replaced. That is reported once, and again only after no call has
  // confirmed it for kRepeatSeconds; failed reads are retried more often than that. `now`: seconds
  // of a monotonic clock.
  void set_replaced(bool replaced, const std::string& message, std::uint64_t offset = 0,
                    double now = clock_seconds()) {
    {
      const std::lock_guard lock(mutex_);
      const bool before = std::exchange(replaced_, replaced);
      const double last = std::exchange(reported_at_, replaced ? now : reported_at_);
      if (!replaced || (before && now - last <= kRepeatSeconds)) return;
    }
    push(PlayerEvent::Kind::kReplaced, offset, message);
  }
  // Removes and returns the queued events, oldest first.
  std::vector<PlayerEvent> take() {
    const std::lock_guard lock(mutex_);
    return events_.take();
  }

 private:
  static constexpr double kRepeatSeconds = 60;
  void push(PlayerEvent::Kind kind, std::uint64_t offset, const std::string& message) noexcept {
    PlayerEvent event = event_of(kind, offset, StatusCode::kIo, message);
    const std::lock_guard lock(mutex_);
    if (!on_opening_) return events_.add(std::move(event));
    try {
      on_opening_(event);
    } catch (...) {
      events_.add(std::move(event));  // the callback is out of memory
    }
  }

  std::mutex mutex_;
  std::function<void(const PlayerEvent&)> on_opening_;
  EventQueue events_;
  bool replaced_ = false;
  double reported_at_ = 0;  // when set_replaced(true) was last called, seconds
};

}  // namespace stgs::player
