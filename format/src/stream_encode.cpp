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
  int count = 1;  // bytes a value
  std::vector<std::uint8_t> bytes;
};

template <typename Value>
Planes split(std::span<const Value> values, std::size_t components) {
  Value all = 0;
  for (Value v : values) all |= v;
  Planes out;
  out.count = std::max(1, (static_cast<int>(std::bit_width(all)) + 7) / 8);
  const std::size_t n = values.size() / components;
  out.bytes.resize(values.size() * static_cast<std::size_t>(out.count));
  std::uint8_t* to = out.bytes.data();
  for (std::size_t c = 0; c < components; ++c) {
    for (int plane = 0; plane < out.count; ++plane) {
      const Value* from = values.data() + c * n;
      for (std::size_t i = 0; i < n; ++i) *to++ = static_cast<std::uint8_t>(from[i] >> (8 * plane));
    }
  }
  return out;
}

// Bits that an ideal order-0 coder would spend, plane by plane.
double entropy_bits(const Planes& planes, std::size_t n) {
  double bits = 0.0;
  for (std::size_t at = 0; at < planes.bytes.size(); at += n) {
    std::array<std::size_t, 256> counts{};
    for (std::size_t i = 0; i < n; ++i) ++counts[planes.bytes[at + i]];
    for (std::size_t count : counts) {
      if (count == 0) continue;
      const auto p = static_cast<double>(count);
      bits -= p * std::log2(p / static_cast<double>(n));
    }
  }
  return bits;
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
std::vector<std::uint8_t> compress(const Planes& planes, std::size_t n, int level) {
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                     &ZSTD_freeCCtx);
  if (!context) throw std::bad_alloc();
  const auto check = [](std::size_t code) {
    if (ZSTD_isError(code)) throw std::runtime_error(ZSTD_getErrorName(code));
    return code;
  };
  check(ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, level));
  check(ZSTD_CCtx_setPledgedSrcSize(context.get(), planes.bytes.size()));
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
    return {Prediction::kMorton, split<std::uint64_t>(deltas, 1)};
  }
  if (integers.mapping == Mapping::kFloat) {
    return {Prediction::kPlain, split<std::uint32_t>(integers.values, components)};
  }
  const bool negative = std::any_of(integers.values.begin(), integers.values.end(),
                                    [](std::uint32_t v) { return (v >> 31) != 0; });
  Candidate best;
  double best_bits = 0.0;
  for (Prediction prediction : {Prediction::kPlain, Prediction::kZigzag, Prediction::kDelta}) {
    if (prediction == (negative ? Prediction::kPlain : Prediction::kZigzag)) continue;
    Planes planes = split<std::uint32_t>(predict(integers, prediction), components);
    const double bits = entropy_bits(planes, integers.values.size() / components);
    if (best.planes.bytes.empty() || bits < best_bits) {
      best = {prediction, std::move(planes)};
      best_bits = bits;
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
  out.entry.planes = static_cast<std::uint8_t>(candidate.planes.count);
  out.entry.exponent = static_cast<std::int8_t>(integers.exponent);
  std::copy_n(integers.origin, 3, out.entry.origin);
  out.entry.checksum = checksum(candidate.planes.bytes);
  const std::size_t n =
      morton ? integers.morton.size()
             : integers.values.size() / static_cast<std::size_t>(integers.components);
  out.bytes = compress(candidate.planes, n, zstd_level);
  out.entry.coder = static_cast<std::uint8_t>(Coder::kZstd);
  if (out.bytes.size() >= candidate.planes.bytes.size()) {
    out.bytes = std::move(candidate.planes.bytes);
    out.entry.coder = static_cast<std::uint8_t>(Coder::kStored);
  }
  out.entry.bytes = out.bytes.size();
  return out;
}

}  // namespace stgs
