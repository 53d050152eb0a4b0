// SPDX-License-Identifier: Apache-2.0
// Annex A: tables, and groups of planes.
#include <algorithm>
#include <bit>
#include <numeric>

#include "interchange/stgs1/layouts.h"

namespace stgs::stgs1 {
namespace {

constexpr std::uint32_t kLow = 65536;                 // lower bound of a state, A.4
constexpr std::uint32_t kBlock = 2048, kSteps = 64;   // primitives of a block, of a lane; A.1
constexpr std::uint32_t kMaxLanes = kBlock / kSteps;  // of a block

// Reads bits, in each byte the lowest first (A.2).
class BitReader {
 public:
  explicit BitReader(ByteReader& in) : in_(in) {}

  int take(int bits) {
    int value = 0;
    for (int i = 0; i < bits; ++i) {
      if (count_ == 0) {
        byte_ = in_.u8();
        count_ = 8;
      }
      value |= (byte_ & 1) << i;
      byte_ >>= 1;
      --count_;
    }
    return value;
  }

  // Reads G(k); -1 if it is invalid.
  int golomb(int k) {
    int u = 0;
    while (take(1) == 0) {
      if (++u > 12 - k) return -1;
    }
    return take(k + u) + (1 << (k + u)) - (1 << k);
  }

  bool has_zero_padding() const { return byte_ == 0; }

 private:
  ByteReader& in_;
  int byte_ = 0, count_ = 0;
};

struct Block {
  std::uint32_t primitives = 0, lanes = 0, words = 0;
  std::uint64_t bytes() const { return 4 * std::uint64_t{lanes} + 2 * std::uint64_t{words}; }
};

Block block_of(std::uint32_t first, std::uint32_t n, std::uint32_t words) {
  const std::uint32_t m = std::min(kBlock, n - first);
  return {m, (m + kSteps - 1) / kSteps, words};
}

// Decodes one block, whose symbols begin at index `first` of each plane (A.4, A.5).
Status decode_block(View bytes, const Block& block, std::uint32_t first,
                    std::span<const Table* const> tables, std::span<std::uint8_t* const> planes) {
  ByteReader in(bytes);
  std::array<std::uint32_t, kMaxLanes> states{};
  for (std::uint32_t lane = 0; lane < block.lanes; ++lane) {
    states[lane] = in.u32();
    if (states[lane] < kLow) return invalid_file("a state of its rANS coder is below 65536");
  }
  const View words = in.bytes(2 * std::uint64_t{block.words});
  std::size_t at = 0;
  for (std::size_t p = 0; p < tables.size(); ++p) {
    const Table& table = *tables[p];
    for (std::uint32_t i = 0, lane = 0; i < block.primitives; ++i) {
      std::uint32_t& x = states[lane];
      if (++lane == block.lanes) lane = 0;
      const std::uint32_t slot = x % kTableTotal;
      const std::uint8_t symbol = table.symbol[slot];
      x = table.frequency[symbol] * (x / kTableTotal) + slot - table.start[symbol];
      if (x < kLow) {
        if (at == words.size()) return invalid_file("a block of its rANS coder is too short");
        x = x << 16 | words[at] | std::uint32_t{words[at + 1]} << 8;
        at += 2;
      }
      planes[p][first + i] = symbol;
    }
  }
  const bool is_complete =
      at == words.size() && std::all_of(states.begin(), states.begin() + block.lanes,
                                        [](std::uint32_t x) { return x == kLow; });
  if (!is_complete) return invalid_file("a block of its rANS coder does not end correctly");
  return {};
}

}  // namespace

Status read_table(ByteReader& in, Table& out) {  // A.2
  const int z = in.u8();
  std::array<int, 256> f{};
  BitReader bits(in);
  int k = 9, s = 0, after = 0, sum = 0;
  while (s < z) {
    const int v = bits.golomb(k);
    if (v < 0) return invalid_file("a table has a number beyond 4095");
    f[s] = v + after;
    sum += f[s];
    if (f[s] > 0) {
      k = std::bit_width(static_cast<unsigned>(f[s])) - 1;
      ++s;
      after = 0;
    } else {
      const int skip = bits.golomb(0);
      if (skip < 0) return invalid_file("a table has a number beyond 4095");
      s += 1 + skip;
      after = 1;
    }
  }
  const int total = kTableTotal;
  if (!in.ok() || s != z || !bits.has_zero_padding() || sum >= total) {
    return invalid_file("a table is truncated or invalid");
  }
  f[z] = total - sum;
  out.is_single = f[z] == total;
  out.only = static_cast<std::uint8_t>(z);
  int start = 0;
  for (int i = 0; i <= z; ++i) {
    out.frequency[i] = static_cast<std::uint16_t>(f[i]);
    out.start[i] = static_cast<std::uint16_t>(start);
    std::fill_n(out.symbol.begin() + start, f[i], static_cast<std::uint8_t>(i));
    start += f[i];
  }
  return {};
}

Status check_group(View group, std::uint32_t n) {  // A.6
  const std::uint64_t blocks = (std::uint64_t{n} + kBlock - 1) / kBlock;
  if (group.size() / 4 < blocks) return invalid_file("its rANS group is truncated");
  ByteReader in(group);
  std::uint64_t bytes = 4 * blocks;
  for (std::uint64_t k = 0; k < blocks; ++k) {
    bytes += block_of(static_cast<std::uint32_t>(k * kBlock), n, in.u32()).bytes();
  }
  if (bytes != group.size()) return invalid_file("the blocks do not fill its rANS group");
  return {};
}

Status decode_group(View group, std::uint32_t n, std::span<const Table* const> tables,
                    std::span<std::uint8_t* const> planes) {
  ByteReader sizes(group), in(group);
  in.bytes(4 * ((std::uint64_t{n} + kBlock - 1) / kBlock));
  for (std::uint64_t first = 0; first < n; first += kBlock) {
    const auto at = static_cast<std::uint32_t>(first);
    const Block block = block_of(at, n, sizes.u32());
    STGS_TRY(decode_block(in.bytes(block.bytes()), block, at, tables, planes));
  }
  return {};
}

}  // namespace stgs::stgs1
