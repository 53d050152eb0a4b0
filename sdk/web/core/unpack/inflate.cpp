// SPDX-License-Identifier: Apache-2.0
#include "unpack/inflate.h"

#include <algorithm>

namespace stgs::web {
namespace {

constexpr int kEndOfBlock = 256, kMaxLiterals = 286, kMaxDistances = 30;
// RFC 1951 3.2.7.
constexpr std::array<std::uint8_t, 19> kLengthOrder = {16, 17, 18, 0, 8,  7, 9,  6, 10, 5,
                                                       11, 4,  12, 3, 13, 2, 14, 1, 15};

// Symbols 257 to 285 (3.2.5): groups of four lengths with one extra bit more each.
std::size_t match_length(int symbol, BitReader& in) {
  const int code = symbol - 257;
  if (code < 8) return static_cast<std::size_t>(3 + code);
  if (code == 28) return 258;
  const int extra = code / 4 - 1;
  return static_cast<std::size_t>(3 + ((4 + code % 4) << extra)) + in.take(extra);
}

std::size_t match_distance(int symbol, BitReader& in) {
  if (symbol < 4) return static_cast<std::size_t>(1 + symbol);
  const int extra = symbol / 2 - 1;
  return static_cast<std::size_t>(1 + ((2 + symbol % 2) << extra)) + in.take(extra);
}

bool is_usable(const PrefixCode& code) {
  return code.size() == 0 || code.is_complete() || code.is_single_bit();
}

}  // namespace

bool Inflate::set_codes(std::span<const std::uint8_t> literals,
                        std::span<const std::uint8_t> distances) {
  return literals_.set(literals) && distances_.set(distances) && is_usable(literals_) &&
         is_usable(distances_);
}

// RFC 1951 3.2.7.
bool Inflate::read_codes() {
  const std::size_t literals = 257 + in_.take(5), distances = 1 + in_.take(5);
  const std::size_t length_codes = 4 + in_.take(4);
  if (literals > kMaxLiterals || distances > kMaxDistances) return false;
  std::array<std::uint8_t, 19> order{};
  for (std::size_t i = 0; i < length_codes; ++i) {
    order[kLengthOrder[i]] = static_cast<std::uint8_t>(in_.take(3));
  }
  PrefixCode code;
  if (!code.set(order) || !code.is_complete()) return false;
  std::array<std::uint8_t, kMaxLiterals + kMaxDistances> lengths{};
  for (std::size_t at = 0; at < literals + distances;) {
    const int symbol = code.read(in_);
    if (symbol < 0 || !in_.ok()) return false;
    std::size_t repeat = 1;
    std::uint8_t value = static_cast<std::uint8_t>(symbol);
    if (symbol == 16) {
      if (at == 0) return false;
      value = lengths[at - 1];
      repeat = 3 + in_.take(2);
    } else if (symbol > 16) {
      value = 0;
      repeat = symbol == 17 ? 3 + in_.take(3) : 11 + in_.take(7);
    }
    if (repeat > literals + distances - at) return false;
    std::fill_n(lengths.begin() + static_cast<std::ptrdiff_t>(at), repeat, value);
    at += repeat;
  }
  return lengths[kEndOfBlock] != 0 && set_codes(std::span(lengths).first(literals),
                                                std::span(lengths).subspan(literals, distances));
}

bool Inflate::begin_block() {
  if (is_last_block_) {
    state_ = State::kEnd;
    return true;
  }
  is_last_block_ = in_.take(1) != 0;
  const std::uint32_t type = in_.take(2);
  state_ = State::kCoded;
  if (type == 0) {
    in_.align();
    const std::uint32_t length = in_.take(16);
    if ((length ^ 0xFFFF) != in_.take(16)) return false;
    stored_left_ = length;
    state_ = State::kStored;
    return in_.ok();
  }
  if (type == 1) {
    std::array<std::uint8_t, 288> lengths;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
      lengths[i] = i < 144 ? 8 : i < 256 ? 9 : i < 280 ? 7 : 8;
    }
    std::array<std::uint8_t, 32> distances;
    distances.fill(5);
    return set_codes(lengths, distances) && in_.ok();
  }
  return type == 2 && read_codes() && in_.ok();
}

bool Inflate::next_symbol() {
  const int symbol = literals_.read(in_);
  if (symbol < 0 || symbol >= kMaxLiterals) return false;
  if (symbol < kEndOfBlock) {
    literal_ = static_cast<std::uint8_t>(symbol);
  } else if (symbol == kEndOfBlock) {
    state_ = State::kBlock;
  } else {
    match_left_ = match_length(symbol, in_);
    const int distance = distances_.read(in_);
    if (distance < 0 || distance >= kMaxDistances) return false;
    distance_ = match_distance(distance, in_);
    if (distance_ > produced_) return false;
  }
  return in_.ok();
}

void Inflate::put(std::uint8_t byte, std::span<std::uint8_t> out, std::size_t& done) {
  out[done++] = byte;
  window_[produced_++ % kWindow] = byte;
}

std::optional<std::size_t> Inflate::read(std::span<std::uint8_t> out) {
  std::size_t done = 0;
  while (done < out.size() && state_ != State::kEnd) {
    if (match_left_ > 0) {
      --match_left_;
      put(window_[(produced_ - distance_) % kWindow], out, done);
    } else if (state_ == State::kBlock) {
      if (!begin_block()) return std::nullopt;
    } else if (state_ == State::kCoded) {
      if (!next_symbol()) return std::nullopt;
      if (literal_) put(*literal_, out, done);
      literal_.reset();
    } else if (stored_left_ > 0) {
      --stored_left_;
      put(static_cast<std::uint8_t>(in_.take(8)), out, done);
      if (!in_.ok()) return std::nullopt;
    } else {
      state_ = State::kBlock;
    }
  }
  return done;
}

}  // namespace stgs::web
