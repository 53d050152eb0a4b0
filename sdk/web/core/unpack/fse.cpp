// SPDX-License-Identifier: Apache-2.0
#include "unpack/fse.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "unpack/bits.h"

namespace stgs::web {
namespace {

int floor_log2(unsigned value) {
  return std::bit_width(value) - 1;
}

}  // namespace

BackwardBits::BackwardBits(std::span<const std::uint8_t> bytes) : bytes_(bytes) {
  if (bytes.empty() || bytes.back() == 0) return;
  left_ = 8 * static_cast<std::int64_t>(bytes.size() - 1) + floor_log2(bytes.back());
}

std::uint64_t BackwardBits::peek(int count) const {
  if (left_ <= 0 || count == 0) return 0;
  const std::uint64_t mask = (std::uint64_t{1} << count) - 1;
  const std::int64_t low = left_ - count;
  const auto first = static_cast<std::size_t>(low > 0 ? low / 8 : 0);
  std::uint64_t word = 0;  // little-endian, as every supported processor
  std::memcpy(&word, &bytes_[first], std::min<std::size_t>(8, bytes_.size() - first));
  if (low >= 0) return word >> (low % 8) & mask;
  return (word & ((std::uint64_t{1} << left_) - 1)) << -low;
}

void FseTable::set(std::span<const std::int16_t> probabilities, int accuracy) {
  accuracy_ = accuracy;
  const unsigned size = 1u << accuracy;
  states_.assign(size, {});
  std::array<std::uint16_t, kMaxSymbols> next{};
  unsigned high = size;  // symbols of probability "less than 1" have the states above
  for (std::size_t s = 0; s < probabilities.size(); ++s) {
    next[s] = static_cast<std::uint16_t>(probabilities[s]);
    if (probabilities[s] != -1) continue;
    states_[--high].symbol = static_cast<std::uint8_t>(s);
    next[s] = 1;
  }
  const unsigned step = (size >> 1) + (size >> 3) + 3;
  unsigned at = 0;
  for (std::size_t s = 0; s < probabilities.size(); ++s) {
    for (int i = 0; i < probabilities[s]; ++i) {
      states_[at].symbol = static_cast<std::uint8_t>(s);
      do at = (at + step) % size;
      while (at >= high);
    }
  }
  for (State& state : states_) {
    const unsigned value = next[state.symbol]++;
    state.bits = static_cast<std::uint8_t>(accuracy - floor_log2(value));
    state.base = static_cast<std::uint16_t>((value << state.bits) - size);
  }
}

void FseTable::set_single(std::uint8_t symbol) {
  accuracy_ = 0;
  states_.assign(1, {symbol, 0, 0});
}

std::size_t FseTable::read(std::span<const std::uint8_t> bytes, int symbols, int max_accuracy) {
  BitReader in(bytes);
  const int accuracy = 5 + static_cast<int>(in.take(4));
  if (accuracy > max_accuracy) return 0;
  std::array<std::int16_t, kMaxSymbols> probabilities{};
  int left = 1 << accuracy, s = 0;
  while (left > 0 && s < symbols) {
    const int bits = floor_log2(static_cast<unsigned>(left) + 1) + 1;
    const int low_mask = (1 << (bits - 1)) - 1, threshold = (1 << bits) - 2 - left;
    int value = static_cast<int>(in.peek(bits));
    if ((value & low_mask) < threshold) {
      value &= low_mask;
      in.skip(bits - 1);
    } else {
      if (value > low_mask) value -= threshold;
      in.skip(bits);
    }
    const int probability = value - 1;
    left -= probability < 0 ? 1 : probability;
    probabilities[static_cast<std::size_t>(s++)] = static_cast<std::int16_t>(probability);
    if (probability != 0) continue;
    for (int repeat = 3; repeat == 3; s += repeat) repeat = static_cast<int>(in.take(2));
  }
  in.align();
  if (left != 0 || s > symbols || !in.ok()) return 0;
  set(std::span(probabilities).first(static_cast<std::size_t>(s)), accuracy);
  return in.position();
}

bool LiteralCode::set(std::span<const std::uint8_t> weights) {
  unsigned sum = 0;
  for (const std::uint8_t weight : weights) {
    if (weight > kMaxBits) return false;
    sum += weight > 0 ? 1u << (weight - 1) : 0u;
  }
  if (sum == 0) return false;
  max_bits_ = floor_log2(sum) + 1;
  const unsigned rest = (1u << max_bits_) - sum;  // of the last symbol, which has no weight stored
  if (max_bits_ > kMaxBits || !std::has_single_bit(rest)) return false;
  std::array<std::uint8_t, 256> all{};
  std::copy(weights.begin(), weights.end(), all.begin());
  all[weights.size()] = static_cast<std::uint8_t>(floor_log2(rest) + 1);
  entries_.assign(std::size_t{1} << max_bits_, {});
  std::size_t at = 0;
  for (int weight = 1; weight <= max_bits_; ++weight) {
    for (std::size_t s = 0; s <= weights.size(); ++s) {
      if (all[s] != weight) continue;
      const Entry entry{static_cast<std::uint8_t>(s),
                        static_cast<std::uint8_t>(max_bits_ + 1 - weight)};
      for (std::size_t i = std::size_t{1} << (weight - 1); i > 0; --i) entries_[at++] = entry;
    }
  }
  return true;
}

std::size_t LiteralCode::read(std::span<const std::uint8_t> bytes) {
  entries_.clear();
  if (bytes.empty()) return 0;
  std::array<std::uint8_t, 255> weights{};
  std::size_t count = 0;
  const std::size_t head = bytes[0];
  if (head >= 128) {  // four bits each, the first in the high ones
    count = head - 127;
    if (bytes.size() < 1 + (count + 1) / 2) return 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t byte = bytes[1 + i / 2];
      weights[i] = i % 2 == 0 ? byte >> 4 : byte & 15;
    }
    return set(std::span(weights).first(count)) ? 1 + (count + 1) / 2 : 0;
  }
  if (bytes.size() < 1 + head) return 0;
  const auto coded = bytes.subspan(1, head);
  FseTable table;
  const std::size_t description = table.read(coded, kMaxBits + 2, 6);
  if (description == 0) return 0;
  // Two states take turns until the bits are consumed.
  BackwardBits in(coded.subspan(description));
  std::array<unsigned, 2> states{};
  for (unsigned& state : states) state = table.first_state(in);
  for (std::size_t turn = 0; in.left() >= 0; turn = 1 - turn) {
    if (count + 2 > weights.size()) return 0;
    weights[count++] = table.symbol(states[turn]);
    states[turn] = table.next_state(states[turn], in);
    if (in.left() < 0) weights[count++] = table.symbol(states[1 - turn]);
  }
  return set(std::span(weights).first(count)) ? 1 + head : 0;
}

bool LiteralCode::decode(std::span<const std::uint8_t> stream, std::span<std::uint8_t> out) const {
  BackwardBits in(stream);
  for (std::uint8_t& byte : out) {
    const Entry entry = entries_[in.peek(max_bits_)];
    byte = entry.symbol;
    in.skip(entry.bits);
  }
  return in.left() == 0;
}

}  // namespace stgs::web
