// SPDX-License-Identifier: Apache-2.0
#include "unpack/bits.h"

namespace stgs::web {

bool PrefixCode::set(std::span<const std::uint8_t> lengths) {
  counts_ = {};
  for (const std::uint8_t length : lengths) ++counts_[length];
  counts_[0] = 0;
  int left = 1;  // codes of the current length that are not taken
  std::array<std::uint16_t, kMaxLength + 2> first{};
  for (int length = 1; length <= kMaxLength; ++length) {
    left = 2 * left - counts_[static_cast<std::size_t>(length)];
    if (left < 0) return false;
    first[static_cast<std::size_t>(length) + 1] = static_cast<std::uint16_t>(
        first[static_cast<std::size_t>(length)] + counts_[static_cast<std::size_t>(length)]);
  }
  is_complete_ = left == 0;
  symbols_.resize(first[kMaxLength + 1]);
  for (std::size_t s = 0; s < lengths.size(); ++s) {
    if (lengths[s] != 0) symbols_[first[lengths[s]]++] = static_cast<std::uint16_t>(s);
  }
  fast_ = {};
  std::size_t index = 0;
  unsigned code = 0;
  for (int length = 1; length <= kFastBits; ++length, code <<= 1) {
    for (int i = 0; i < counts_[static_cast<std::size_t>(length)]; ++i, ++code, ++index) {
      unsigned reversed = 0;
      for (int bit = 0; bit < length; ++bit) reversed |= (code >> bit & 1u) << (length - 1 - bit);
      for (unsigned at = reversed; at < fast_.size(); at += 1u << length) {
        fast_[at] = static_cast<std::uint16_t>(symbols_[index] << 4 | length);
      }
    }
  }
  return true;
}

int PrefixCode::read(BitReader& in) const {
  const std::uint32_t bits = in.peek(kMaxLength);
  if (const std::uint16_t entry = fast_[bits % fast_.size()]; entry != 0) {
    in.skip(entry & 15);
    return entry >> 4;
  }
  // `first`: the lowest code of a length, which belongs to symbols_[index].
  int code = 0, first = 0, index = 0;
  for (int length = 1; length <= kMaxLength; ++length) {
    code |= static_cast<int>(bits >> (length - 1) & 1u);
    const int count = counts_[static_cast<std::size_t>(length)];
    if (code - first < count) {
      in.skip(length);
      return symbols_[static_cast<std::size_t>(index + code - first)];
    }
    index += count;
    first = 2 * (first + count);
    code *= 2;
  }
  return -1;
}

}  // namespace stgs::web
