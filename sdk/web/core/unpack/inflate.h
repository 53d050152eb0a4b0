// SPDX-License-Identifier: Apache-2.0
// Decodes DEFLATE (RFC 1951), for the import module, which has no zlib.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "unpack/bits.h"

namespace stgs::web {

class Inflate {
 public:
  // The bytes must outlive the object. Those behind the stream are ignored.
  explicit Inflate(std::span<const std::uint8_t> bytes) : in_(bytes) {}

  // Fills `out`, or less at the end of the stream. Returns the number of bytes; none if the stream
  // is damaged or truncated.
  std::optional<std::size_t> read(std::span<std::uint8_t> out);
  // Returns the number of bytes that have been consumed.
  std::size_t position() const { return in_.position(); }

 private:
  enum class State { kBlock, kStored, kCoded, kEnd };
  static constexpr std::size_t kWindow = 32768;

  bool begin_block();
  bool read_codes();
  bool set_codes(std::span<const std::uint8_t> literals, std::span<const std::uint8_t> distances);
  // Decodes a symbol: sets `literal`, or the match, or the end of the block. False: damaged.
  bool next_symbol();
  void put(std::uint8_t byte, std::span<std::uint8_t> out, std::size_t& done);

  BitReader in_;
  State state_ = State::kBlock;
  bool is_last_block_ = false;
  std::optional<std::uint8_t> literal_;
  std::size_t stored_left_ = 0, match_left_ = 0, distance_ = 0;
  PrefixCode literals_, distances_;
  std::array<std::uint8_t, kWindow> window_{};
  std::uint64_t produced_ = 0;
};

}  // namespace stgs::web
