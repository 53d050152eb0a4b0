// SPDX-License-Identifier: Apache-2.0
// Tables of the rANS coder: optimal table for given counts, cost, serialisation.
#include <algorithm>
#include <bit>
#include <limits>

#include "codec/rans.h"

namespace stgs {
namespace {

constexpr int kLogBits = 28;  // fractional bits of a logarithm

// log2(f) for f from 1 to 4096, with kLogBits fractional bits.
constexpr auto kLog2 = [] {
  std::array<std::uint32_t, kRansTotal + 1> table{};
  for (std::uint32_t f = 1; f <= kRansTotal; ++f) {
    const int whole = std::bit_width(f) - 1;
    auto log = static_cast<std::uint32_t>(whole);
    // Squaring doubles the logarithm of a mantissa in [1, 2), here with 63 fractional bits.
    std::uint64_t mantissa = std::uint64_t{f} << (63 - whole);
    for (int bit = 0; bit < kLogBits; ++bit) {
      const auto square = static_cast<unsigned __int128>(mantissa) * mantissa;
      const bool carry = (square >> 127) != 0;
      mantissa = static_cast<std::uint64_t>(square >> (carry ? 64 : 63));
      log = log << 1 | carry;
    }
    table[f] = log;
  }
  return table;
}();

// Returns the bits, times 2^kLogBits, saved by one more slot for a symbol of this count and
// frequency.
std::uint64_t saving(std::uint32_t count, std::uint32_t frequency) {
  return std::uint64_t{count} * (kLog2[frequency + 1] - kLog2[frequency]);
}

// Frequencies proportional to the counts, at least 1 for each symbol in use. Their sum may differ
// from kRansTotal until adjusted.
struct Fit {
  std::array<std::uint32_t, 256> symbol{};  // symbols in use
  std::array<std::uint32_t, 256> count{}, frequency{};
  std::array<std::uint64_t, 256> gain{}, loss{};  // of one slot more or less
  std::size_t used = 0;
  std::uint32_t sum = 0;

  explicit Fit(std::span<const std::uint32_t, 256> counts) {
    std::uint64_t total = 0;
    for (const std::uint32_t c : counts) total += c;
    if (total == 0) return;
    for (std::uint32_t s = 0; s < 256; ++s) {
      if (counts[s] == 0) continue;
      symbol[used] = s;
      count[used] = counts[s];
      const auto share = static_cast<std::uint32_t>(std::uint64_t{counts[s]} * kRansTotal / total);
      change(used++, std::max(1u, share));
    }
  }
  void change(std::size_t i, std::uint32_t f) {
    sum += f - frequency[i];
    frequency[i] = f;
    gain[i] = f < kRansTotal ? saving(count[i], f) : 0;
    loss[i] = f > 1 ? saving(count[i], f - 1) : std::numeric_limits<std::uint64_t>::max();
  }
  std::size_t best_gain() const {
    return static_cast<std::size_t>(std::max_element(gain.begin(), gain.begin() + used) -
                                    gain.begin());
  }
  std::size_t least_loss() const {
    return static_cast<std::size_t>(std::min_element(loss.begin(), loss.begin() + used) -
                                    loss.begin());
  }
  void grow() {
    const std::size_t i = best_gain();
    change(i, frequency[i] + 1);
  }
  void shrink() {
    const std::size_t i = least_loss();
    change(i, frequency[i] - 1);
  }
};

// Writes numbers lowest bit first, into bytes lowest bit first.
class BitWriter {
 public:
  explicit BitWriter(ByteWriter& out) : out_(out) {}
  void put(std::uint32_t value, int bits) {
    for (int i = 0; i < bits; ++i) {
      byte_ |= (value >> i & 1u) << used_;
      if (++used_ == 8) flush();
    }
  }
  // Exponential Golomb code of order k: short for values up to about 2^k.
  void put_golomb(std::uint32_t value, int k) {
    const std::uint32_t shifted = value + (1u << k);
    const int low = std::bit_width(shifted) - 1;
    put(1u << (low - k), low - k + 1);
    put(shifted, low);
  }
  void flush() {
    if (used_ == 0) return;
    out_.u8(static_cast<std::uint8_t>(byte_));
    byte_ = 0;
    used_ = 0;
  }

 private:
  ByteWriter& out_;
  std::uint32_t byte_ = 0;
  int used_ = 0;
};

class BitReader {
 public:
  explicit BitReader(ByteReader& in) : in_(in) {}
  std::uint32_t get(int bits) {  // 0 to 24
    for (; left_ < bits; left_ += 8) ahead_ |= std::uint32_t{in_.u8()} << left_;
    const std::uint32_t value = ahead_ & ((1u << bits) - 1);
    ahead_ >>= bits;
    left_ -= bits;
    return value;
  }
  // Returns a value below 4096, or 4096 if the code exceeds it.
  std::uint32_t get_golomb(int k) {
    int low = k;
    while (get(1) == 0) {
      if (++low > kRansBits) return kRansTotal;
    }
    return std::min(kRansTotal, get(low) + (1u << low) - (1u << k));
  }
  bool rest_is_zero() const { return ahead_ == 0; }

 private:
  ByteReader& in_;
  std::uint32_t ahead_ = 0;  // of the last byte
  int left_ = 0;
};

// Order of the code of the next frequency: neighbours have similar frequencies.
int order_after(std::uint32_t frequency) {
  return std::bit_width(frequency) - 1;
}
constexpr int kFirstOrder = 9;

}  // namespace

RansTable rans_table(std::span<const std::uint32_t, 256> counts) {
  Fit fit(counts);
  RansTable table;
  if (fit.used == 0) {
    table.frequency[0] = kRansTotal;
    return table;
  }
  while (fit.sum < kRansTotal) fit.grow();
  while (fit.sum > kRansTotal) fit.shrink();
  // The cost is convex: the table is optimal if moving a single slot does not improve it.
  while (fit.gain[fit.best_gain()] > fit.loss[fit.least_loss()]) {
    fit.shrink();
    fit.grow();
  }
  for (std::size_t i = 0; i < fit.used; ++i)
    table.frequency[fit.symbol[i]] = static_cast<std::uint16_t>(fit.frequency[i]);
  return table;
}

double rans_cost(const RansTable& table, std::span<const std::uint32_t, 256> counts) {
  std::uint64_t cost = 0;
  for (std::size_t s = 0; s < 256; ++s) {
    if (counts[s] == 0) continue;
    if (table.frequency[s] == 0) return std::numeric_limits<double>::infinity();
    cost += std::uint64_t{counts[s]} * (kLog2[kRansTotal] - kLog2[table.frequency[s]]);
  }
  return static_cast<double>(cost) / (1u << kLogBits);
}

void write_rans_table(const RansTable& table, ByteWriter& out) {
  const auto& f = table.frequency;
  std::size_t last = 255;
  while (last > 0 && f[last] == 0) --last;
  out.u8(static_cast<std::uint8_t>(last));
  BitWriter bits(out);
  int order = kFirstOrder;
  bool after_zeros = false;
  for (std::size_t s = 0; s < last; ++s) {
    bits.put_golomb(f[s] - (after_zeros ? 1u : 0u), order);
    after_zeros = f[s] == 0;
    if (!after_zeros) {
      order = order_after(f[s]);
      continue;
    }
    std::uint32_t more = 0;
    while (s + 1 < last && f[s + 1] == 0) {
      ++more;
      ++s;
    }
    bits.put_golomb(more, 0);
  }
  bits.flush();
}

bool read_rans_table(ByteReader& in, RansTable& table, std::int16_t& only) {
  const std::size_t last = in.u8();
  BitReader bits(in);
  int order = kFirstOrder;
  bool after_zeros = false;
  std::uint32_t left = kRansTotal;
  for (std::size_t s = 0; s < last; ++s) {
    const std::uint32_t f = bits.get_golomb(order) + (after_zeros ? 1u : 0u);
    if (f >= left) return false;  // the last symbol needs at least one slot
    table.frequency[s] = static_cast<std::uint16_t>(f);
    left -= f;
    after_zeros = f == 0;
    if (!after_zeros) {
      order = order_after(f);
      continue;
    }
    const std::uint32_t more = bits.get_golomb(0);
    if (more >= last - s) return false;
    s += more;
  }
  if (!in.ok() || !bits.rest_is_zero()) return false;
  table.frequency[last] = static_cast<std::uint16_t>(left);
  only = left == kRansTotal ? static_cast<std::int16_t>(last) : std::int16_t{-1};
  return true;
}

Result<RansTable> read_rans_table(ByteReader& in) {
  const std::size_t begin = in.position();
  RansTable table;
  std::int16_t only = -1;
  if (read_rans_table(in, table, only)) return table;
  return invalid_file("invalid table of symbol frequencies at byte {}", begin);
}

void rans_lookup(const RansTable& table, RansLookup& lookup) {
  std::uint32_t slot = 0;
  for (std::uint32_t s = 0; s < 256; ++s) {
    const std::uint32_t f = table.frequency[s];
    const std::uint32_t entry = s << 24 | (f - 1) % kRansTotal << kRansBits;
    const std::uint32_t count = std::min(f, kRansTotal - slot);
    std::uint32_t* const out = lookup.data() + slot;
    for (std::uint32_t i = 0; i < count; ++i) out[i] = entry | i;
    slot += count;
  }
}

}  // namespace stgs
