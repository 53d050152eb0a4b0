// SPDX-License-Identifier: Apache-2.0
// The entropy coders of Zstandard (RFC 8878, 4).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace stgs::web {

// Reads bits from the end of a stream to its begin (RFC 8878, 4.1). Bits before the begin are zero.
class BackwardBits {
 public:
  explicit BackwardBits(std::span<const std::uint8_t> bytes);

  // Returns the next bits, at most 57, without consuming them.
  std::uint64_t peek(int count) const;
  void skip(int count) { left_ -= count; }
  std::uint64_t take(int count) {
    const std::uint64_t bits = peek(count);
    skip(count);
    return bits;
  }
  // Returns the number of bits that are left: negative if more were consumed than the stream has,
  // or if it lacks the mark of its end.
  std::int64_t left() const { return left_; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::int64_t left_ = -1;
};

// A decoding table of finite state entropy (RFC 8878, 4.1).
class FseTable {
 public:
  static constexpr int kMaxAccuracy = 9;  // log2 of the greatest number of states
  static constexpr int kMaxSymbols = 53;

  // Sets a table by the probability of each symbol, -1 for "less than 1"; they add up to
  // 2^accuracy.
  void set(std::span<const std::int16_t> probabilities, int accuracy);
  // Sets a table of one symbol, which takes no bits.
  void set_single(std::uint8_t symbol);
  // Reads the description of a table of at most `symbols` symbols. Returns its bytes; 0 if it is
  // damaged.
  std::size_t read(std::span<const std::uint8_t> bytes, int symbols, int max_accuracy);

  bool is_set() const { return !states_.empty(); }
  // A state is a number below 2^accuracy.
  unsigned first_state(BackwardBits& in) const { return static_cast<unsigned>(in.take(accuracy_)); }
  std::uint8_t symbol(unsigned state) const { return states_[state].symbol; }
  unsigned next_state(unsigned state, BackwardBits& in) const {
    return states_[state].base + static_cast<unsigned>(in.take(states_[state].bits));
  }

 private:
  struct State {
    std::uint8_t symbol = 0, bits = 0;
    std::uint16_t base = 0;
  };
  std::vector<State> states_;
  int accuracy_ = 0;
};

// The prefix code of literals (RFC 8878, 4.2).
class LiteralCode {
 public:
  // Reads the description of a code. Returns its bytes; 0 if it is damaged.
  std::size_t read(std::span<const std::uint8_t> bytes);
  bool is_set() const { return !entries_.empty(); }
  // Decodes one stream, which holds exactly `out`. Returns false if it is damaged.
  bool decode(std::span<const std::uint8_t> stream, std::span<std::uint8_t> out) const;

 private:
  static constexpr int kMaxBits = 11;

  struct Entry {
    std::uint8_t symbol = 0, bits = 0;
  };
  bool set(std::span<const std::uint8_t> weights);

  std::vector<Entry> entries_;  // by the next max_bits_ bits
  int max_bits_ = 0;
};

}  // namespace stgs::web
