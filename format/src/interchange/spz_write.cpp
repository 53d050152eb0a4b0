// SPDX-License-Identifier: Apache-2.0
// Writing SPZ version 4.
#include <zstd.h>

#include <algorithm>
#include <cmath>

#include "core/bytes.h"
#include "interchange/import.h"
#include "interchange/spz.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kZstdLevel = 12;
constexpr float kMaxFixed = 8388607.0f;  // signed 24 bits
// Bits of each SH coefficient of degree 1, and above; as in other writers.
constexpr int kDegree1Bits = 5, kRestBits = 4;

std::uint8_t byte_of(float value) {
  return static_cast<std::uint8_t>(std::clamp(std::round(value), 0.0f, 255.0f));
}

// Returns the number of fractional bits: 12, as in other writers, or as many as give steps of 2^-16
// of the farthest coordinate; fewer if that coordinate needs more integer bits. -1 if it does not
// fit.
int fraction_bits_for(const Gaussians4D& set) {
  float farthest = 0.0f;
  for (float v : set.position) farthest = std::max(farthest, std::abs(v));
  int exponent = 0;
  std::frexp(farthest, &exponent);  // farthest < 2^exponent
  const int bits = std::min({std::max(12, 16 - exponent), 23 - exponent, 20});
  return std::max(bits, -1);
}

void pack_position(const float* position, float steps, std::uint8_t* out) {
  for (std::size_t c = 0; c < 3; ++c) {
    const auto fixed = static_cast<std::uint32_t>(static_cast<std::int32_t>(
        std::clamp(std::round(position[c] * steps), -kMaxFixed, kMaxFixed)));
    for (std::size_t b = 0; b < 3; ++b) {
      out[3 * c + b] = static_cast<std::uint8_t>(fixed >> (8 * b));
    }
  }
}

// The inverse of smallest_three() in the reader. `q`: w x y z of any nonzero length.
void pack_rotation(const float* q, std::uint8_t* out) {
  const float xyzw[4] = {q[1], q[2], q[3], q[0]};
  double squared = 0.0;
  std::size_t largest = 0;
  for (std::size_t c = 0; c < 4; ++c) {
    squared += double{xyzw[c]} * xyzw[c];
    if (std::abs(xyzw[c]) > std::abs(xyzw[largest])) largest = c;
  }
  const bool negate = xyzw[largest] < 0.0f;
  const double scale = 511.0 / (spz::kHalfRoot * std::sqrt(squared));
  auto word = static_cast<std::uint32_t>(largest);
  for (std::size_t c = 0; c < 4; ++c) {
    if (c == largest) continue;
    const double magnitude = std::min(511.0, std::round(std::abs(xyzw[c]) * scale));
    const bool negative = (xyzw[c] < 0.0f) != negate;
    word = word << 10 | (negative ? 512u : 0u) | static_cast<std::uint32_t>(magnitude);
  }
  for (std::size_t b = 0; b < 4; ++b) out[b] = static_cast<std::uint8_t>(word >> (8 * b));
}

// Returns the nearest multiple of 2^(8 - bits), relative to 128, which represents 0.
std::uint8_t pack_sh(float value, int bits) {
  const auto step = static_cast<float>(1 << (8 - bits));
  const float steps = std::round(128.0f * value / step);
  return static_cast<std::uint8_t>(std::clamp(128.0f + steps * step, 0.0f, 255.0f));
}

void pack(const Gaussians4D& set, std::size_t i, float steps,
          std::array<Bytes, spz::kArrays>& arrays) {
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  const float* sh = set.sh.data() + 3 * i * coefficients;
  pack_position(set.position.data() + 3 * i, steps, arrays[spz::kPositions].data() + 9 * i);
  pack_rotation(set.rotation.data() + 4 * i, arrays[spz::kRotations].data() + 4 * i);
  arrays[spz::kOpacities][i] = byte_of(255.0f * math::opacity_of(set.opacity_logit[i]));
  for (std::size_t c = 0; c < 3; ++c) {
    arrays[spz::kScales][3 * i + c] = byte_of(16.0f * (set.log_scale[3 * i + c] + 10.0f));
    arrays[spz::kColours][3 * i + c] = byte_of(255.0f * (spz::kColourScale * sh[c] + 0.5f));
  }
  std::uint8_t* rest = arrays[spz::kSh].data() + 3 * (coefficients - 1) * i;
  for (std::size_t k = 3; k < 3 * coefficients; ++k) {
    rest[k - 3] = pack_sh(sh[k], k < 12 ? kDegree1Bits : kRestBits);
  }
}

// Counts the values of an attribute outside the range of a format, and their greatest excess.
class Clipped {
 public:
  void count(double value, double low, double high) {
    const double beyond = std::max(low - value, value - high);
    ++count_;
    if (!(beyond > 0)) return;
    ++clipped_;
    max_excess_ = std::max(max_excess_, beyond);
  }
  void note(const char* values, const char* range, ConversionNotes& notes) const {
    if (clipped_ == 0) return;
    notes.push_back(fmt::format("clipped {} of {} {} to the range of SPZ, {}, by up to {:.3g}",
                                clipped_, count_, values, range, max_excess_));
  }

 private:
  std::size_t count_ = 0, clipped_ = 0;
  double max_excess_ = 0;
};

// Adds notes about values that pack() clips by more than half a step.
void note_clipping(const Gaussians4D& set, ConversionNotes& notes) {
  constexpr double kHalfScale = 0.5 / 16, kHalfColour = 0.5 / 255;
  const double reach = (0.5 + kHalfColour) * math::kSh00 / spz::kColourScale;
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  Clipped scales, colours, sh;
  for (const float v : set.log_scale) {
    scales.count(v, -10.0 - kHalfScale, 255.0 / 16 - 10 + kHalfScale);
  }
  for (std::size_t k = 0; k < set.sh.size(); ++k) {
    if (k % (3 * coefficients) >= 3) {
      sh.count(set.sh[k], -1.0, 1.0);
    } else {
      colours.count(double{math::kSh00} * set.sh[k] + 0.5, 0.5 - reach, 0.5 + reach);
    }
  }
  scales.note("log scales", "-10 to 5.94", notes);
  colours.note("colours", "-0.44 to 1.44", notes);
  sh.note("SH coefficients", "-1 to 1", notes);
}

Bytes header_of(const Gaussians4D& set, int fraction_bits, int kernel, std::size_t streams) {
  ByteWriter out;
  out.u32(spz::kMagic);
  out.u32(4);
  out.u32(static_cast<std::uint32_t>(set.size()));
  out.u8(static_cast<std::uint8_t>(set.sh_degree));
  out.u8(static_cast<std::uint8_t>(fraction_bits));
  out.u8(kernel == math::kBandLimited ? spz::kAntialiased : 0);
  out.u8(static_cast<std::uint8_t>(streams));
  out.u32(spz::kHeader);  // the table of contents follows
  for (int i = 0; i < 12; ++i) out.u8(0);
  return out.take();
}

}  // namespace

Result<std::vector<std::uint8_t>> write_spz(Gaussians4D set, ConversionNotes* notes, int kernel) {
  STGS_TRY(check_export(set));
  if (set.size() == 0) return unsupported("SPZ cannot represent a set without primitives");
  if (set.size() > 0x7FFFFFFF) {
    return unsupported("too many primitives for SPZ (at most 2^31 - 1, got {})", set.size());
  }
  const int fraction_bits = fraction_bits_for(set);
  if (fraction_bits < 0) {
    return unsupported("coordinates exceed the range of SPZ (at most 8388607)");
  }
  if (notes != nullptr) note_clipping(set, *notes);
  flip_axes(set, 1, -1, -1);
  std::array<Bytes, spz::kArrays> arrays;
  const auto strides = spz::strides(4, set.sh_degree);
  for (std::size_t a = 0; a < strides.size(); ++a) arrays[a].resize(set.size() * strides[a]);
  const float steps = std::ldexp(1.0f, fraction_bits);
  parallel_blocks(std::size_t{0}, set.size(), kPrimitivesPerTask,
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t i = first; i < last; ++i) pack(set, i, steps, arrays);
                  });
  const std::size_t streams = set.sh_degree > 0 ? arrays.size() : arrays.size() - 1;
  std::array<Bytes, spz::kArrays> frames;
  std::array<std::size_t, spz::kArrays> sizes{};
  parallel_for(std::size_t{0}, streams, [&](std::size_t a) {
    frames[a].resize(ZSTD_compressBound(arrays[a].size()));
    sizes[a] = ZSTD_compress(frames[a].data(), frames[a].size(), arrays[a].data(), arrays[a].size(),
                             kZstdLevel);
  });
  ByteWriter out;
  out.bytes(header_of(set, fraction_bits, kernel, streams));
  for (std::size_t a = 0; a < streams; ++a) {
    if (ZSTD_isError(sizes[a])) return runtime_error("zstd: {}", ZSTD_getErrorName(sizes[a]));
    out.u64(sizes[a]);
    out.u64(arrays[a].size());
  }
  for (std::size_t a = 0; a < streams; ++a) {
    out.bytes(std::span(frames[a]).first(sizes[a]));
  }
  return out.take();
}

}  // namespace stgs
