// SPDX-License-Identifier: Apache-2.0
// Mapping planes to floats, a block of primitives at a time, in loops that the compiler vectorises.
// Each loop processes a full block. A partial block is padded with its last primitive, so that
// checks find no additional errors.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "codec/stream_map.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "codec/stream_map_vector.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

#include "codec/store_floats-inl.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kAhead = 2 * kBlock;  // prefetch distance in a plane, symbols
using Numbers = std::uint32_t[kBlock];
using Keys = std::uint64_t[kBlock];

// 2^e, |e| <= 126.
HWY_INLINE float power_of_two(int e) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(e + 127) << 23);
}

// Returns multiplier * 2^exponent, exactly. Its product with an integer in range is exact, too.
HWY_INLINE float size_of(Step step) {
  return static_cast<float>(step.multiplier) * power_of_two(step.exponent);
}

// Loads values [first, first + count) of a component with the digits `planes`, padded with zeros.
template <typename Value>
HWY_INLINE void load(const StreamRow& row, const Plane* planes, std::size_t first,
                     std::size_t count, Value (&out)[kBlock]) {
  Value same = 0;
  int shift = 0;
  for (std::size_t d = 0; d < row.digits; shift += row.digit_bits[d++]) {
    if (planes[d].symbols == nullptr) same |= Value{planes[d].only} << shift;
  }
  for (Value& v : out) v = same;
  shift = 0;
  for (std::size_t d = 0; d < row.digits; shift += row.digit_bits[d++]) {
    if (planes[d].symbols == nullptr) continue;
    std::uint8_t digits[kBlock];
    // There are too many planes for the CPU's hardware prefetcher.
    __builtin_prefetch(planes[d].symbols + first + kAhead);
    if (count == kBlock) {  // a copy of constant size becomes a load
      std::memcpy(digits, planes[d].symbols + first, kBlock);
    } else {
      std::memset(digits, 0, kBlock);
      std::memcpy(digits, planes[d].symbols + first, count);
    }
    for (std::size_t i = 0; i < kBlock; ++i) out[i] |= Value{digits[i]} << shift;
  }
  for (std::size_t i = count; i < kBlock; ++i) out[i] = 0;
}

// Replaces each number by the sum of `before` and all numbers up to it. Returns the last one.
HWY_INLINE std::uint32_t running_sums(std::uint32_t before, Numbers& q) {
#if HWY_TARGET == HWY_SCALAR
  for (std::uint32_t& v : q) v = before += v;
  return before;
#else
  const hn::FixedTag<std::uint32_t, 4> d;
  auto carry = hn::Set(d, before);
  for (std::size_t i = 0; i < kBlock; i += 4) {
    auto v = hn::Load(d, q + i);
    v = hn::Add(v, hn::ShiftLeftLanes<1>(d, v));
    v = hn::Add(v, hn::ShiftLeftLanes<2>(d, v));
    v = hn::Add(v, carry);
    hn::Store(v, d, q + i);
    carry = hn::Broadcast<3>(v);
  }
  return hn::GetLane(carry);
#endif
}

HWY_INLINE void undo_prediction(Prediction prediction, std::uint64_t& carry, Numbers& q) {
  if (prediction == Prediction::kPlain) return;
  for (std::size_t i = 0; i < kBlock; ++i) q[i] = unzigzag(q[i]);
  if (prediction == Prediction::kDelta) carry = running_sums(static_cast<std::uint32_t>(carry), q);
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

HWY_INLINE bool map_truncated(const StreamRow& row, const Numbers& q, Floats& out) {
  const auto first = std::bit_cast<std::uint32_t>(row.origin[0]);
  const std::uint32_t step = static_cast<std::uint32_t>(row.step.multiplier) << row.step.exponent;
  const std::uint32_t limit = (kMaxTruncated - first) / step;
  std::uint32_t bad = 0;
  for (std::size_t i = 0; i < kBlock; ++i) {
    bad |= q[i] > limit ? 1u : 0u;
    out[i] = std::bit_cast<float>(first + q[i] * step) - row.origin[1];
  }
  return bad == 0;
}

// Computes the steps of displacements over these lifespans.
HWY_INLINE void displacement_steps(const StreamRow& row, const Gaussians4D& set, float part_ticks,
                                   std::size_t first, std::size_t count, Floats& out) {
  for (std::size_t i = 0; i < count; ++i) {
    const int life = lifespan_exponent(set.sigma[first + i], set.radius[first + i], part_ticks);
    const int exponent = std::clamp(row.step.exponent - life, kMinExponent, kMaxExponent);
    out[i] = size_of({exponent, row.step.multiplier});
  }
  for (std::size_t i = count; i < kBlock; ++i) out[i] = 0.0f;
}

HWY_INLINE void rotation_exponents(const StreamRow& row, const Gaussians4D& set, std::size_t first,
                                   std::size_t count, int (&out)[kBlock]) {
  const bool shaped = static_cast<Mapping>(row.mapping) == Mapping::kShapedRotation;
  for (int& e : out) e = row.step.exponent;
  const float* log_scale = set.log_scale.data() + 3 * first;
  for (std::size_t i = 0; shaped && i < count; ++i) out[i] += rotation_shift(log_scale + 3 * i);
  for (int& e : out) e = std::clamp(e, kMinRotationExponent, kMaxRotationExponent);
  std::fill(out + count, out + kBlock, out[count - 1]);
}

// Computes w, x, y, z. R is exact in double precision; its rounding to single precision and its
// square root are correctly rounded (spec 7.5.5).
HWY_INLINE bool map_rotation(int multiplier, const Numbers* q, const int (&exponents)[kBlock],
                             Floats* out) {
  std::uint32_t bad = 0;
  const double m = multiplier;
  for (std::size_t i = 0; i < kBlock; ++i) {
    const double x = m * static_cast<std::int32_t>(q[0][i]),
                 y = m * static_cast<std::int32_t>(q[1][i]),
                 z = m * static_cast<std::int32_t>(q[2][i]);
    const float one = power_of_two(-2 * exponents[i]);
    const double rest = static_cast<double>(one) - x * x - y * y - z * z;
    bad |= rest > 0.0 ? 0u : 1u;
    out[0][i] = static_cast<float>(rest > 0.0 ? rest : 0.0);
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

// Converts luma and chroma to RGB in integers (spec 7.5.6).
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

// Maps a block of one component, of which the first `count` numbers are valid.
bool map_component(const StreamRow& row, int component, std::int64_t base, const Floats& steps,
                   std::size_t count, Numbers& q, Floats& out) {
  const std::uint32_t limit = max_steps(static_cast<Mapping>(row.mapping), row.step.multiplier);
  switch (static_cast<Mapping>(row.mapping)) {
    case Mapping::kFloat:
      for (std::size_t i = 0; i < kBlock; ++i) out[i] = std::bit_cast<float>(q[i]);
      return true;
    case Mapping::kTruncated:
      return in_range(q, limit) && map_truncated(row, q, out);
    case Mapping::kDisplacement:
      to_floats(q, out);
      for (std::size_t i = 0; i < kBlock; ++i) out[i] *= steps[i];
      return in_range(q, limit);
    case Mapping::kTime: {
      const bool good = in_range(q, limit);
      for (std::size_t i = 0; i < kBlock; ++i) {
        q[i] = i < count ? q[i] + static_cast<std::uint32_t>(base) : 0;
      }
      map_linear(row.origin[0], size_of(row.step), q, out);
      return good && in_range(q, limit);  // the sums too (spec 7.5.8)
    }
    default:
      map_linear(row.origin[component % 3], size_of(row.step), q, out);
      return in_range(q, limit);
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

// Returns whether all values of these planes are 0.
HWY_INLINE bool all_zero(const Plane* planes, std::size_t count) {
  return std::all_of(planes, planes + count,
                     [](const Plane& p) { return p.symbols == nullptr && p.only == 0; });
}

// Maps primitives [begin, end) of a stream of floats or integers. `carry`: the sum of the values
// before `begin`; updated to that before `end`.
bool map_values(const StreamTask& task, const SegmentContext& context, std::size_t begin,
                std::size_t end, std::uint64_t* carry, Gaussians4D& set) {
  const StreamRow& row = *task.row;
  const auto mapping = static_cast<Mapping>(row.mapping);
  const auto prediction = static_cast<Prediction>(row.prediction);
  const AttributeView<float> view = view_of(set, static_cast<Attribute>(row.attribute));
  const std::int64_t base = time_origin(context.begin, row.step);
  const bool rotation = mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation;
  const bool together = rotation || mapping == Mapping::kColour;
  const std::size_t width = rotation ? 4 : row.components;
  HWY_ALIGN Numbers q[3];
  HWY_ALIGN Floats floats[kMaxComponents], steps;
  HWY_ALIGN int exponents[kBlock];
  bool good = true;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t count = std::min(kBlock, end - first);
    if (rotation) rotation_exponents(row, set, first, count, exponents);
    if (mapping == Mapping::kDisplacement)
      displacement_steps(row, set, context.part_ticks, first, count, steps);
    for (std::size_t c = 0; c < row.components; ++c) {
      if (c % 3 == 0 && mapping == Mapping::kColour &&
          all_zero(task.planes + c * row.digits, std::size_t{3} * row.digits)) {
        std::fill(&floats[c][0], &floats[c][0] + 3 * kBlock, 0.0f);
        c += 2;
        continue;
      }
      Numbers& block = q[together ? c % 3 : 0];
      load(row, task.planes + c * row.digits, first, count, block);
      undo_prediction(prediction, carry[c], block);
      if (count < kBlock) std::fill(block + count, block + kBlock, block[count - 1]);
      if (!together) {
        good &= map_component(row, static_cast<int>(c), base, steps, count, block, floats[c]);
      } else if (c % 3 == 2) {
        good &= map_three(row, exponents, q, floats + (c - 2));
      }
    }
    store_all(floats, width, count, view.data + first * view.stride, view.stride);
  }
  return good;
}

// As above for Morton keys.
bool map_keys(const StreamTask& task, std::size_t begin, std::size_t end, std::uint64_t* carry,
              Gaussians4D& set) {
  const StreamRow& row = *task.row;
  HWY_ALIGN Keys keys;
  HWY_ALIGN Numbers q;
  HWY_ALIGN Floats floats[3];
  const std::uint32_t limit = max_steps(Mapping::kLinear, row.step.multiplier);
  std::uint64_t key = *carry, overflow = key;
  bool good = true;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t count = std::min(kBlock, end - first);
    load(row, task.planes, first, count, keys);
    for (std::size_t i = 0; i < kBlock; ++i) {
      overflow |= keys[i];
      key += keys[i];
      overflow |= key;
      keys[i] = key;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t i = 0; i < kBlock; ++i) q[i] = compact3(keys[i] >> axis);
      good &= in_range(q, limit);
      map_linear(row.origin[axis], size_of(row.step), q, floats[axis]);
    }
    store<3>(floats, count, set.position.data() + 3 * first, 3);
  }
  *carry = key;
  return good && overflow >> 63 == 0;
}

bool map_task(const StreamTask& task, const SegmentContext& context, std::size_t begin,
              std::size_t end, std::uint64_t* carry, Gaussians4D& set) {
  if (static_cast<Prediction>(task.row->prediction) == Prediction::kMorton)
    return map_keys(task, begin, end, carry, set);
  return map_values(task, context, begin, end, carry, set);
}

void sum_task(const StreamTask& task, std::size_t begin, std::size_t end, std::uint64_t* sums) {
  const StreamRow& row = *task.row;
  const bool keys = static_cast<Prediction>(row.prediction) == Prediction::kMorton;
  HWY_ALIGN Keys wide;
  HWY_ALIGN Numbers q;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t count = std::min(kBlock, end - first);
    for (std::size_t c = 0; c < row.components; ++c) {
      std::uint64_t sum = 0;
      if (keys) {
        load(row, task.planes, first, count, wide);
        for (const std::uint64_t v : wide) sum += v;
      } else {
        load(row, task.planes + c * row.digits, first, count, q);
        for (const std::uint32_t v : q) sum += unzigzag(v);
      }
      sums[c] += sum;
    }
  }
}

bool all_finite(const FloatArray& values, std::size_t begin, std::size_t end) {
  std::uint32_t bad = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(values[i]) & 0x7F800000;
    bad |= bits == 0x7F800000 ? 1u : 0u;
  }
  return bad == 0;
}

bool all_renderable(const Gaussians4D& set, std::uint32_t floats, std::size_t begin,
                    std::size_t end) {
  std::uint32_t bad = 0;
  for (std::size_t i = begin; i < end; ++i) {
    bad |= set.sigma[i] > 0.0f ? 0u : 1u;
    bad |= set.radius[i] >= 0.0f ? 0u : 1u;
    const float* q = set.rotation.data() + 4 * i;
    bad |= q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f ? 1u : 0u;
  }
  const auto finite = [&](Attribute attribute, const FloatArray& values, std::size_t width) {
    return (floats & attribute_bit(attribute)) == 0 ||
           all_finite(values, width * begin, width * end);
  };
  const auto sh = static_cast<std::size_t>(3 * set.sh_coefficients());
  const std::uint32_t any_sh = attribute_bit(Attribute::kSh0) | attribute_bit(Attribute::kSh1) |
                               attribute_bit(Attribute::kSh2) | attribute_bit(Attribute::kSh3);
  return bad == 0 && finite(Attribute::kPosition, set.position, 3) &&
         finite(Attribute::kTime, set.time, 1) && finite(Attribute::kSigma, set.sigma, 1) &&
         finite(Attribute::kRadius, set.radius, 1) &&
         finite(Attribute::kVelocity, set.velocity, 3) &&
         finite(Attribute::kLogScale, set.log_scale, 3) &&
         finite(Attribute::kRotation, set.rotation, 4) &&
         finite(Attribute::kOpacity, set.opacity_logit, 1) &&
         ((floats & any_sh) == 0 || all_finite(set.sh, sh * begin, sh * end));
}

}  // namespace
}  // namespace stgs::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs {

HWY_EXPORT(map_task);
HWY_EXPORT(sum_task);
HWY_EXPORT(all_renderable);

bool map_task(const StreamTask& task, const SegmentContext& context, std::size_t begin,
              std::size_t end, std::uint64_t* carry, Gaussians4D& set) {
  return HWY_DYNAMIC_DISPATCH(map_task)(task, context, begin, end, carry, set);
}

void sum_task(const StreamTask& task, std::size_t begin, std::size_t end, std::uint64_t* sums) {
  HWY_DYNAMIC_DISPATCH(sum_task)(task, begin, end, sums);
}

bool all_renderable(const Gaussians4D& set, std::uint32_t floats, std::size_t begin,
                    std::size_t end) {
  return HWY_DYNAMIC_DISPATCH(all_renderable)(set, floats, begin, end);
}

}  // namespace stgs
#endif
