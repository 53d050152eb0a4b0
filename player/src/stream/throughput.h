// SPDX-License-Identifier: Apache-2.0
// What a link has carried of late.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace stgs::player {

// Bytes over the time in which at least one transfer was under way; what is old counts for less.
// Times are seconds of a clock that never goes back. Not thread-safe.
class Throughput {
 public:
  void begin(double now) {
    pass(now);
    ++transfers_;
  }
  void add_bytes(std::uint64_t bytes, double now) {
    pass(now);
    bytes_ += static_cast<double>(bytes);
  }
  void end(double now) {
    pass(now);
    --transfers_;
  }
  // What has been carried so far tells nothing any more.
  void forget() { bytes_ = seconds_ = 0; }
  // 0: not known yet.
  double bytes_per_second() const { return seconds_ < kLeast ? 0.0 : bytes_ / seconds_; }

 private:
  static constexpr double kHalfLife = 2, kLeast = 0.02;  // seconds under way

  void pass(double now) {
    const double passed = transfers_ > 0 ? std::max(now - at_, 0.0) : 0.0;
    const double kept = std::exp2(-passed / kHalfLife);
    bytes_ *= kept;
    seconds_ = seconds_ * kept + passed;
    at_ = now;
  }

  double at_ = 0, bytes_ = 0, seconds_ = 0;
  int transfers_ = 0;
};

}  // namespace stgs::player
