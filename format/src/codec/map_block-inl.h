// SPDX-License-Identifier: Apache-2.0
// The mappings of integers to floats (spec 8.5 to 8.8), a block of primitives at a time. Include
// after hwy/foreach_target.h, once per target.
#if defined(STGS_MAP_BLOCK_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef STGS_MAP_BLOCK_INL_H
#undef STGS_MAP_BLOCK_INL_H
#else
#define STGS_MAP_BLOCK_INL_H
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <hwy/highway.h>

#include "codec/store_floats-inl.h"
#include "codec/stream.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::HWY_NAMESPACE {
namespace {

using Numbers = std::uint32_t[kBlock];

// 2^e, |e| <= 126.
HWY_INLINE float power_of_two(int e) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(e + 127) << 23);
}

// Returns multiplier * 2^exponent, exactly. Its product with an integer in range is exact, too.
HWY_INLINE float size_of(Step step) {
  return static_cast<float>(step.multiplier) * power_of_two(step.exponent);
}

// Returns whether all |q| are at most `limit`.
HWY_INLINE bool in_range(const Numbers& q, std::uint32_t limit) {
  std::uint32_t bad = 0;
  for (std::size_t i = 0; i < kBlock; ++i) bad |= q[i] + limit > 2 * limit ? 1u : 0u;
  return bad == 0;
}

HWY_INLINE void to_floats(const Numbers& q, Floats& out) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    out[i] = static_cast<float>(static_cast<std::int32_t>(q[i]));
  }
}

HWY_INLINE void map_linear(float origin, float step, const Numbers& q, Floats& out) {
  to_floats(q, out);
  for (std::size_t i = 0; i < kBlock; ++i) out[i] = origin + step * out[i];
}

// Replaces q by the bits b (spec 8.5).
HWY_INLINE bool map_truncated(const StreamRow& row, Numbers& q, Floats& out) {
  const auto first = std::bit_cast<std::uint32_t>(row.origin[0]);
  const std::uint32_t step = static_cast<std::uint32_t>(row.step.multiplier) << row.step.exponent;
  const std::uint32_t limit = (kMaxTruncated - first) / step;
  std::uint32_t bad = 0;
  for (std::size_t i = 0; i < kBlock; ++i) {
    bad |= q[i] > limit ? 1u : 0u;
    q[i] = first + q[i] * step;
    out[i] = std::bit_cast<float>(q[i]) - row.origin[1];
  }
  return bad == 0;
}

// Computes the steps of displacements over these lifespans.
HWY_INLINE void displacement_steps(const StreamRow& row, const std::uint32_t* sigma,
                                   const std::uint32_t* radius, int part_exponent, Floats& out) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    const int life = lifespan_exponent(sigma[i], radius[i], part_exponent);
    const int exponent = std::clamp(row.step.exponent - life, kMinExponent, kMaxExponent);
    out[i] = size_of({exponent, row.step.multiplier});
  }
}

HWY_INLINE void rotation_exponents(const StreamRow& row, const SegmentContext& context,
                                   const std::uint32_t* spread, int (&out)[kBlock]) {
  const bool shaped = static_cast<Mapping>(row.mapping) == Mapping::kShapedRotation;
  for (std::size_t i = 0; i < kBlock; ++i) {
    const int shift = shaped ? rotation_shift(context.shape_bounds, spread[i]) : 0;
    out[i] = std::clamp(row.step.exponent + shift, kMinRotationExponent, kMaxRotationExponent);
  }
}

// Computes w, x, y, z (spec 8.7). R is below 2^28; only its conversion to float rounds.
HWY_INLINE bool map_rotation(int multiplier, const Numbers* q, const int (&exponents)[kBlock],
                             Floats* out) {
  std::uint32_t bad = 0;
  const auto m = static_cast<std::uint32_t>(multiplier);
  for (std::size_t i = 0; i < kBlock; ++i) {
    const std::uint32_t x = m * q[0][i], y = m * q[1][i], z = m * q[2][i];
    const std::uint32_t limit = 1u << -exponents[i];
    const std::uint32_t widest = std::max({x + limit - 1, y + limit - 1, z + limit - 1});
    auto rest = static_cast<std::int32_t>(limit * limit - x * x - y * y - z * z);
    rest = widest <= 2 * limit - 2 ? std::max(rest, 0) : 0;
    bad |= rest == 0 ? 1u : 0u;
    out[0][i] = static_cast<float>(rest);
  }
  for (std::size_t i = 0; i < kBlock; ++i) {
    out[0][i] = power_of_two(exponents[i]) * std::sqrt(out[0][i]);
  }
  for (std::size_t c = 0; c < 3; ++c) {
    to_floats(q[c], out[c + 1]);
    for (std::size_t i = 0; i < kBlock; ++i) {
      out[c + 1][i] *= size_of({exponents[i], multiplier});
    }
  }
  return bad == 0;
}

// Converts luma and chroma to RGB in integers (spec 8.5).
HWY_INLINE void map_colour(const StreamRow& row, const Numbers* q, Floats* out) {
  Numbers red, green, blue;
  for (std::size_t i = 0; i < kBlock; ++i) {
    const std::uint32_t luma = q[0][i], orange = q[1][i], chroma = q[2][i];
    red[i] = luma - chroma + orange;
    green[i] = luma + chroma;
    blue[i] = luma - chroma - orange;
  }
  const float step = size_of(row.step);
  map_linear(0.0f, step, red, out[0]);
  map_linear(0.0f, step, green, out[1]);
  map_linear(0.0f, step, blue, out[2]);
}

// Maps a block of one component. `base`: of times. `steps`: of displacements. Sigma and radius
// leave their bits in q.
bool map_component(const StreamRow& row, std::size_t component, float base, const Floats& steps,
                   Numbers& q, Floats& out) {
  const std::uint32_t limit = max_steps(static_cast<Mapping>(row.mapping), row.step.multiplier);
  const bool good = in_range(q, limit);
  switch (static_cast<Mapping>(row.mapping)) {
    case Mapping::kFloat:
      for (std::size_t i = 0; i < kBlock; ++i) {
        q[i] <<= row.step.exponent;
        out[i] = std::bit_cast<float>(q[i]);
      }
      return true;
    case Mapping::kTruncated:
      return map_truncated(row, q, out) && good;
    case Mapping::kDisplacement:
      to_floats(q, out);
      for (std::size_t i = 0; i < kBlock; ++i) out[i] *= steps[i];
      return good;
    case Mapping::kTime:
      map_linear(row.origin[0], size_of(row.step), q, out);
      for (std::size_t i = 0; i < kBlock; ++i) out[i] += base;
      return good;
    default:
      map_linear(row.origin[component % 3], size_of(row.step), q, out);
      return good;
  }
}

// Maps three components that give three or four floats together.
bool map_three(const StreamRow& row, const int (&exponents)[kBlock], const Numbers* q,
               Floats* out) {
  const std::uint32_t limit = max_steps(static_cast<Mapping>(row.mapping), row.step.multiplier);
  const bool good = in_range(q[0], limit) && in_range(q[1], limit) && in_range(q[2], limit);
  if (static_cast<Mapping>(row.mapping) != Mapping::kColour) {
    return map_rotation(row.step.multiplier, q, exponents, out) && good;
  }
  map_colour(row, q, out);
  return good;
}

}  // namespace
}  // namespace stgs::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
