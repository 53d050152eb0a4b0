// SPDX-License-Identifier: Apache-2.0
// The time limit of a read from a URL.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "stgs/player/source.h"

namespace stgs::player {

// The time limit of one read with a connection, to its last byte: name lookup, connecting, TLS,
// redirections, headers, bodies, and pauses between attempts. Ends HttpSettings::request_seconds
// after it begins, and later by the time that the bytes of this read take at
// HttpSettings::min_bytes_per_second: a server that keeps to this mean rate has as long as it
// needs. One thread at a time.
class Deadline {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Deadline(const HttpSettings& settings)
      : limit_(settings.request_seconds), rate_(settings.min_bytes_per_second) {}

  // Extends the limit for bytes of the file that have arrived.
  void add_bytes(std::uint64_t count) { bytes_ += static_cast<double>(count); }
  // Returns the seconds since the beginning.
  double elapsed() const { return std::chrono::duration<double>(Clock::now() - begin_).count(); }
  // Returns the seconds that are left, at least 0.
  double remaining() const { return std::max(0.0, limit_ + bytes_ / rate_ - elapsed()); }
  bool has_passed() const { return remaining() == 0; }
  double min_bytes_per_second() const { return rate_; }

 private:
  Clock::time_point begin_ = Clock::now();
  double limit_, rate_, bytes_ = 0;
};

}  // namespace stgs::player
