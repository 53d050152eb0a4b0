// SPDX-License-Identifier: Apache-2.0
// Reads through the host, without waiting.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "stream/async_byte_source.h"

namespace stgs::web {

// One object at a time: the ids of its reads are those of the host.
class PageTransport final : public player::AsyncByteSource {
 public:
  explicit PageTransport(std::string name) : name_(std::move(name)) {}

  void start(Completion completion) override { completion_ = std::move(completion); }
  void begin_read(std::uint64_t id, std::uint64_t offset,
                  std::span<std::uint8_t> out) noexcept override;
  void cancel(std::uint64_t id) noexcept override;
  void stop() noexcept override;

  // Returns a new id for a read of the host.
  std::uint32_t next_id() { return next_++; }
  // Called by the host: the read has ended, with a message if it failed. `now`: seconds of the
  // clock that pump() has.
  void done(std::uint32_t host_id, const std::string& failure, double now);

 private:
  const std::string name_;
  Completion completion_;
  std::map<std::uint32_t, std::uint64_t> reads_;  // ids of this object by those of the host
  std::uint32_t next_ = 1;
  double busy_since_ = 0, busy_seconds_ = 0;  // seconds of the clock
  bool stopped_ = false;
};

}  // namespace stgs::web
