// SPDX-License-Identifier: Apache-2.0
// Bits of DEFLATE and of lossless WebP: the lowest bit of a byte comes first.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace stgs::web {

// Reads zeros past the end, where ok() becomes false.
class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  // Returns the next bits, at most 32, without consuming them.
  std::uint32_t peek(int count) {
    while (held_ < count) {
      bits_ |= std::uint64_t{at_ < bytes_.size() ? bytes_[at_] : 0u} << held_;
      ++at_;
      held_ += 8;
    }
    return static_cast<std::uint32_t>(bits_ & ((std::uint64_t{1} << count) - 1));
  }
  // Consumes bits that have been peeked at.
  void skip(int count) {
    bits_ >>= count;
    held_ -= count;
  }
  std::uint32_t take(int count) {
    const std::uint32_t bits = peek(count);
    skip(count);
    return bits;
  }
  // Skips the rest of a byte.
  void align() { skip(held_ % 8); }

  // Returns the number of bytes that are consumed, at least in part.
  std::size_t position() const { return at_ - static_cast<std::size_t>(held_ / 8); }
  bool ok() const { return position() <= bytes_.size(); }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  std::uint64_t bits_ = 0;
  int held_ = 0;
};

// A canonical prefix code of at most 4096 symbols, whose codes have at most 15 bits.
class PrefixCode {
 public:
  // Sets the code by the length of each symbol's code, bits; 0: unused. Returns false if there are
  // more codes than fit.
  bool set(std::span<const std::uint8_t> lengths);

  std::size_t size() const { return symbols_.size(); }  // used symbols
  bool is_complete() const { return is_complete_; }
  // Returns whether the one code has one bit.
  bool is_single_bit() const { return size() == 1 && counts_[1] == 1; }
  // Returns the only symbol of a code of one symbol.
  int only_symbol() const { return symbols_[0]; }
  // Returns the next symbol; -1 if an incomplete code has none for the bits.
  int read(BitReader& in) const;

 private:
  static constexpr int kMaxLength = 15, kFastBits = 9;

  std::array<std::uint16_t, kMaxLength + 1> counts_{};  // of codes, by length
  std::vector<std::uint16_t> symbols_;                  // by code
  // By the next bits: 16 symbol + length of codes of at most kFastBits; 0 for others.
  std::array<std::uint16_t, 1 << kFastBits> fast_{};
  bool is_complete_ = false;
};

}  // namespace stgs::web
