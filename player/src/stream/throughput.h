// SPDX-License-Identifier: Apache-2.0
// The recent throughput of a link.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace stgs::player {

// Bytes per time during which at least one transfer was in flight, with exponentially decaying
// weights. Times are seconds of a monotonic clock. Not thread-safe.
class Throughput {
 public:
  // Begins a transfer.
  void begin(double now) {
    advance(now);
    ++transfers_;
  }
  // Counts bytes of a transfer in flight.
  void add_bytes(std::uint64_t bytes, double now) {
    advance(now);
    bytes_ += static_cast<double>(bytes);
  }
  // Ends a transfer.
  void end(double now) {
    advance(now);
    --transfers_;
  }
  // Discards the measurements so far.
  void reset() { bytes_ = seconds_ = 0; }
  // Returns the throughput; 0: not yet known.
  double bytes_per_second() const { return seconds_ < kMinSeconds ? 0.0 : bytes_ / seconds_; }

 private:
  static constexpr double kHalfLife = 2, kMinSeconds = 0.02;  // of time with transfers in flight

  void advance(double now) {
    const double passed = transfers_ > 0 ? std::max(now - at_, 0.0) : 0.0;
    const double decay = std::exp2(-passed / kHalfLife);
    bytes_ *= decay;
    seconds_ = seconds_ * decay + passed;
    at_ = now;
  }

  double at_ = 0, bytes_ = 0, seconds_ = 0;
  int transfers_ = 0;  // in flight
};

}  // namespace stgs::player
