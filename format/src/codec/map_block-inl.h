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

// Checks that all |q| of a stream are at most `limit`.
class Range {
 public:
  explicit Range(std::uint32_t limit) : limit_(limit) {}
  HWY_INLINE void add(std::size_t i, std::uint32_t q) {
    greatest_[i] = std::max(greatest_[i], q + limit_);
  }
  HWY_INLINE void add(const Numbers& q) {
    for (std::size_t i = 0; i < kBlock; ++i) add(i, q[i]);
  }
  HWY_INLINE bool good() const {
    std::uint32_t greatest = 0;
    for (const std::uint32_t v : greatest_) greatest = std::max(greatest, v);
    return greatest <= 2 * limit_;
  }

 private:
  std::uint32_t limit_;
  HWY_ALIGN Numbers greatest_ = {};  // q + limit, modulo 2^32
};

HWY_INLINE float to_float(std::uint32_t q) {
  return static_cast<float>(static_cast<std::int32_t>(q));
}

HWY_INLINE void map_linear(float origin, float step, const Numbers& q, Floats& out) {
  for (std::size_t i = 0; i < kBlock; ++i) out[i] = origin + step * to_float(q[i]);
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
  const hn::CappedTag<std::uint32_t, 16> d;
  const hn::RebindToSigned<decltype(d)> di;
  const hn::RebindToFloat<decltype(d)> df;
  const auto one = hn::Set(d, 1), m = hn::Set(d, static_cast<std::uint32_t>(multiplier));
  auto bad = hn::Zero(di);
  for (std::size_t i = 0; i < kBlock; i += hn::MaxLanes(d)) {
    const auto x = hn::Mul(m, hn::Load(d, q[0] + i)), y = hn::Mul(m, hn::Load(d, q[1] + i));
    const auto z = hn::Mul(m, hn::Load(d, q[2] + i));
    const auto limit = hn::Shl(one, hn::BitCast(d, hn::Neg(hn::Load(di, exponents + i))));
    // |v| < limit if v + (limit - 1) <= 2 (limit - 1), modulo 2^32.
    const auto most = hn::Sub(limit, one), twice = hn::Add(most, most);
    const auto greatest = hn::Max(hn::Max(hn::Add(x, most), hn::Add(y, most)), hn::Add(z, most));
    const auto inside = hn::Eq(hn::Max(greatest, twice), twice);
    const auto squares = hn::Add(hn::Add(hn::Mul(x, x), hn::Mul(y, y)), hn::Mul(z, z));
    const auto rest = hn::Sub(hn::Mul(limit, limit), squares);
    const auto found = hn::BitCast(di, hn::IfThenElseZero(inside, rest));
    const auto good = hn::Max(found, hn::Zero(di));
    bad = hn::Or(bad, hn::VecFromMask(di, hn::Eq(good, hn::Zero(di))));
    hn::Store(hn::ConvertTo(df, good), df, out[0] + i);
  }
  for (std::size_t i = 0; i < kBlock; ++i) {
    out[0][i] = power_of_two(exponents[i]) * std::sqrt(out[0][i]);
  }
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < kBlock; ++i) {
      out[c + 1][i] = to_float(q[c][i]) * size_of({exponents[i], multiplier});
    }
  }
  return hn::AllTrue(di, hn::Eq(bad, hn::Zero(di)));
}

// Converts luma and chroma to RGB in integers (spec 8.5).
HWY_INLINE void map_colour(const StreamRow& row, const Numbers* q, Floats* out) {
  const float step = size_of(row.step);
  for (std::size_t i = 0; i < kBlock; ++i) {
    const std::uint32_t luma = q[0][i], orange = q[1][i], chroma = q[2][i];
    // 0 + x is x, except that it is never -0.
    out[0][i] = 0.0f + step * to_float(luma - chroma + orange);
    out[1][i] = 0.0f + step * to_float(luma + chroma);
    out[2][i] = 0.0f + step * to_float(luma - chroma - orange);
  }
}

// Maps a block of one component. `base`: of times. `steps`: of displacements. Sigma and radius
// leave their bits in q. Returns false if an integer exceeds another limit than that of `range`.
HWY_INLINE bool map_component(const StreamRow& row, std::size_t component, float base,
                              const Floats& steps, Numbers& q, Range& range, Floats& out) {
  const float origin = row.origin[component % 3], step = size_of(row.step);
  switch (static_cast<Mapping>(row.mapping)) {
    case Mapping::kFloat:
      for (std::size_t i = 0; i < kBlock; ++i) {
        q[i] <<= row.step.exponent;
        out[i] = std::bit_cast<float>(q[i]);
      }
      return true;
    case Mapping::kTruncated:
      range.add(q);
      return map_truncated(row, q, out);
    case Mapping::kDisplacement:
      for (std::size_t i = 0; i < kBlock; ++i) {
        range.add(i, q[i]);
        out[i] = to_float(q[i]) * steps[i];
      }
      return true;
    case Mapping::kTime:
      range.add(q);
      map_linear(row.origin[0], step, q, out);
      for (std::size_t i = 0; i < kBlock; ++i) out[i] += base;
      return true;
    default:
      for (std::size_t i = 0; i < kBlock; ++i) {
        range.add(i, q[i]);
        out[i] = origin + step * to_float(q[i]);
      }
      return true;
  }
}

// Maps three components that give three or four floats together.
HWY_INLINE bool map_three(const StreamRow& row, const int (&exponents)[kBlock], const Numbers* q,
                          Range& range, Floats* out) {
  for (std::size_t c = 0; c < 3; ++c) range.add(q[c]);
  if (static_cast<Mapping>(row.mapping) != Mapping::kColour)
    return map_rotation(row.step.multiplier, q, exponents, out);
  map_colour(row, q, out);
  return true;
}

}  // namespace
}  // namespace stgs::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
