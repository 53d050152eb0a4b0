// SPDX-License-Identifier: Apache-2.0
#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <numeric>
#include <stdexcept>

#include "container.h"
#include "stream.h"

namespace stgs {
namespace {

struct Planes {
  int digit_bits = 8, digits = 1;
  std::size_t bytes_each = 0;
  std::vector<std::uint8_t> bytes;
};

template <typename Value>
Planes split(std::span<const Value> values, std::size_t components, int digit_bits) {
  Value all = 0;
  for (Value v : values) all |= v;
  const std::size_t n = values.size() / components;
  Planes out;
  out.digit_bits = digit_bits;
  out.digits = std::max(1, (static_cast<int>(std::bit_width(all)) + digit_bits - 1) / digit_bits);
  out.bytes_each = plane_bytes(n, digit_bits);
  out.bytes.resize(out.bytes_each * components * static_cast<std::size_t>(out.digits));
  const auto per_byte = static_cast<std::size_t>(8 / digit_bits);
  const Value mask = static_cast<Value>((1u << digit_bits) - 1);
  std::uint8_t* to = out.bytes.data();
  for (std::size_t c = 0; c < components; ++c) {
    const Value* from = values.data() + c * n;
    for (int digit = 0; digit < out.digits; ++digit, to += out.bytes_each) {
      const int shift = digit * digit_bits;
      for (std::size_t place = 0; place < per_byte; ++place) {
        const int to_shift = static_cast<int>(place) * digit_bits;
        for (std::size_t i = place, b = 0; i < n; i += per_byte, ++b) {
          to[b] |= static_cast<std::uint8_t>((from[i] >> shift & mask) << to_shift);
        }
      }
    }
  }
  return out;
}

// Bytes that zstd's literals take, plane by plane: order-0 entropy, but a bit a byte at least.
double estimate(const Planes& planes) {
  double bytes = 0.0;
  for (std::size_t at = 0; at < planes.bytes.size(); at += planes.bytes_each) {
    std::array<std::size_t, 256> counts{};
    for (std::size_t i = 0; i < planes.bytes_each; ++i) ++counts[planes.bytes[at + i]];
    const auto n = static_cast<double>(planes.bytes_each);
    double bits = 0.0;
    std::size_t symbols = 0;
    for (std::size_t count : counts) {
      if (count == 0) continue;
      ++symbols;
      bits -= static_cast<double>(count) * std::log2(static_cast<double>(count) / n);
    }
    // A plane of one value is a run; a table costs about half a byte a symbol.
    if (symbols > 1)
      bytes += std::min(n, std::max(bits, n) / 8.0 + 0.5 * static_cast<double>(symbols));
  }
  return bytes;
}

std::vector<std::uint32_t> predict(const Integers& integers, Prediction prediction) {
  std::vector<std::uint32_t> out = integers.values;
  if (prediction == Prediction::kPlain) return out;
  const std::size_t n = out.size() / static_cast<std::size_t>(integers.components);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const bool first = i % n == 0;
    const std::uint32_t before =
        prediction == Prediction::kDelta && !first ? integers.values[i - 1] : 0;
    out[i] = zigzag(static_cast<std::int32_t>(integers.values[i] - before));
  }
  return out;
}

// One zstd frame. A block ends with each plane, so that every plane gets its own statistics.
std::vector<std::uint8_t> compress(const Planes& planes, int level) {
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                     &ZSTD_freeCCtx);
  if (!context) throw std::bad_alloc();
  const auto check = [](std::size_t code) {
    if (ZSTD_isError(code)) throw std::runtime_error(ZSTD_getErrorName(code));
    return code;
  };
  check(ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, level));
  check(ZSTD_CCtx_setPledgedSrcSize(context.get(), planes.bytes.size()));
  const std::size_t n = planes.bytes_each;
  const std::size_t blocks = planes.bytes.size() / n;
  std::vector<std::uint8_t> out(ZSTD_compressBound(planes.bytes.size()) + 16 * blocks);
  ZSTD_outBuffer to{out.data(), out.size(), 0};
  for (std::size_t block = 0; block < blocks; ++block) {
    ZSTD_inBuffer from{planes.bytes.data() + block * n, n, 0};
    const ZSTD_EndDirective end = block + 1 == blocks ? ZSTD_e_end : ZSTD_e_flush;
    while (check(ZSTD_compressStream2(context.get(), &to, &from, end)) != 0) {
      if (to.pos == to.size) throw std::runtime_error("zstd needs more than its bound");
    }
  }
  out.resize(to.pos);
  return out;
}

struct Candidate {
  Prediction prediction = Prediction::kPlain;
  Planes planes;
};

Candidate best_prediction(const Integers& integers) {
  const auto components = static_cast<std::size_t>(integers.components);
  if (!integers.morton.empty()) {
    std::vector<std::uint64_t> deltas(integers.morton.size());
    std::adjacent_difference(integers.morton.begin(), integers.morton.end(), deltas.begin());
    return {Prediction::kMorton, split<std::uint64_t>(deltas, 1, 8)};
  }
  if (integers.mapping == Mapping::kFloat) {
    return {Prediction::kPlain, split<std::uint32_t>(integers.values, components, 8)};
  }
  const bool negative = std::any_of(integers.values.begin(), integers.values.end(),
                                    [](std::uint32_t v) { return (v >> 31) != 0; });
  Candidate best;
  double best_bytes = 0.0;
  for (Prediction prediction : {Prediction::kPlain, Prediction::kZigzag, Prediction::kDelta}) {
    if (prediction == (negative ? Prediction::kPlain : Prediction::kZigzag)) continue;
    const std::vector<std::uint32_t> predicted = predict(integers, prediction);
    for (int digit_bits : {8, 4, 2}) {
      Planes planes = split<std::uint32_t>(predicted, components, digit_bits);
      const double bytes = estimate(planes);
      if (best.planes.bytes.empty() || bytes < best_bytes) {
        best = {prediction, std::move(planes)};
        best_bytes = bytes;
      }
    }
  }
  return best;
}

}  // namespace

EncodedStream encode_stream(const Integers& integers, int zstd_level) {
  Candidate candidate = best_prediction(integers);
  const bool morton = candidate.prediction == Prediction::kMorton;
  EncodedStream out;
  out.entry.attribute = static_cast<std::uint16_t>(integers.attribute);
  out.entry.components = static_cast<std::uint8_t>(morton ? 1 : integers.components);
  out.entry.mapping = static_cast<std::uint8_t>(integers.mapping);
  out.entry.prediction = static_cast<std::uint8_t>(candidate.prediction);
  out.entry.digit_bits = static_cast<std::uint8_t>(candidate.planes.digit_bits);
  out.entry.digits = static_cast<std::uint8_t>(candidate.planes.digits);
  out.entry.exponent = static_cast<std::int8_t>(integers.exponent);
  std::copy_n(integers.origin, 3, out.entry.origin);
  out.entry.checksum = checksum(candidate.planes.bytes);
  out.bytes = compress(candidate.planes, zstd_level);
  out.entry.coder = static_cast<std::uint8_t>(Coder::kZstd);
  if (out.bytes.size() >= candidate.planes.bytes.size()) {
    out.bytes = std::move(candidate.planes.bytes);
    out.entry.coder = static_cast<std::uint8_t>(Coder::kStored);
  }
  out.entry.bytes = out.bytes.size();
  return out;
}

}  // namespace stgs
