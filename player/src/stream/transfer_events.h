// SPDX-License-Identifier: Apache-2.0
// What transfers met with, until it is asked for.
#pragma once

#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "stgs/player/player.h"

namespace stgs::player {

// Thread-safe.
class TransferEvents {
 public:
  void add(const TransferEvent& event) {
    if (event.kind == TransferEvent::Kind::kFailed) return;  // the pieces tell
    if (event.kind == TransferEvent::Kind::kReplaced) {
      return set_replaced(true, event.message, event.offset);
    }
    put(PlayerEvent::Kind::kRetry, event.offset, event.message);
  }
  // Whether the file is another one now; that is told once as long as it is.
  void set_replaced(bool replaced, const std::string& message, std::uint64_t offset = 0) {
    {
      const std::lock_guard lock(mutex_);
      if (std::exchange(replaced_, replaced) || !replaced) return;
    }
    put(PlayerEvent::Kind::kReplaced, offset, message);
  }
  std::vector<PlayerEvent> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(events_, {});
  }

 private:
  void put(PlayerEvent::Kind kind, std::uint64_t offset, const std::string& message) {
    PlayerEvent event;
    event.kind = kind;
    event.offset = offset;
    event.code = StatusCode::kIo;
    event.message = message;
    const std::lock_guard lock(mutex_);
    events_.push_back(std::move(event));
  }

  std::mutex mutex_;
  std::vector<PlayerEvent> events_;
  bool replaced_ = false;
};

}  // namespace stgs::player
