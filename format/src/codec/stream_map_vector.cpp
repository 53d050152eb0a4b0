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

#include "codec/map_block-inl.h"
#include "codec/store_floats-inl.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kAhead = 2 * kBlock;  // prefetch distance in a plane, symbols

// Digits of a block of values.
struct Digits {
  const std::uint8_t* symbols[kMaxDigits];  // of the digits that vary
  int shift[kMaxDigits];
  std::size_t count = 0;   // of these digits
  std::uint32_t same = 0;  // the others
  HWY_ALIGN std::uint8_t padded[kMaxDigits][kBlock];
};

// Locates the digits of values [first, first + count) in these planes. Pads them with zeros.
HWY_INLINE void locate(const Plane* planes, const std::uint8_t* digit_bits, std::size_t digits,
                       std::size_t first, std::size_t count, Digits& out) {
  int shift = 0;
  for (std::size_t d = 0; d < digits; shift += digit_bits[d++]) {
    if (planes[d].symbols == nullptr) {
      out.same |= std::uint32_t{planes[d].only} << shift;
      continue;
    }
    const std::uint8_t* symbols = planes[d].symbols + first;
    // There are too many planes for the CPU's hardware prefetcher.
    __builtin_prefetch(symbols + kAhead);
    if (count < kBlock) {
      std::uint8_t* const padded = out.padded[out.count];
      std::memset(padded, 0, kBlock);
      std::memcpy(padded, symbols, count);
      symbols = padded;
    }
    out.symbols[out.count] = symbols;
    out.shift[out.count++] = shift;
  }
}

// Combines the digits of a block, kCount of which vary, or more if it is kMaxDigits. kSigned:
// undoes zigzag coding.
template <bool kSigned, std::size_t kCount>
HWY_INLINE void combine(const Digits& from, Numbers& out) {
  const hn::CappedTag<std::uint32_t, 16> d;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  const std::size_t digits = kCount == kMaxDigits ? from.count : kCount;
  for (std::size_t i = 0; i < kBlock; i += hn::MaxLanes(d)) {
    auto v = hn::Set(d, from.same);
    for (std::size_t k = 0; k < digits; ++k) {
      const auto digit = hn::PromoteTo(d, hn::LoadU(d8, from.symbols[k] + i));
      v = hn::Or(v, hn::ShiftLeftSame(digit, from.shift[k]));
    }
    if constexpr (kSigned) {
      const auto sign = hn::Sub(hn::Zero(d), hn::And(v, hn::Set(d, 1)));
      v = hn::Xor(hn::ShiftRight<1>(v), sign);
    }
    hn::Store(v, d, out + i);
  }
}

// Loads values [first, first + count) with these planes of digits, padded with zeros. kSigned:
// undoes their zigzag coding.
template <bool kSigned>
HWY_INLINE void load(const Plane* planes, const std::uint8_t* digit_bits, std::size_t digits,
                     std::size_t first, std::size_t count, Numbers& out) {
  Digits from;
  locate(planes, digit_bits, digits, first, count, from);
  if (from.count == 1) {
    combine<kSigned, 1>(from, out);
  } else if (from.count == 2) {
    combine<kSigned, 2>(from, out);
  } else {
    combine<kSigned, kMaxDigits>(from, out);
  }
  if (count < kBlock) std::fill(out + count, out + kBlock, 0u);
}

// Loads values of component c of a stream.
template <bool kSigned>
HWY_INLINE void load_component(const StreamTask& task, std::size_t c, std::size_t first,
                               std::size_t count, Numbers& out) {
  const StreamRow& row = *task.row;
  load<kSigned>(task.planes + c * row.digits, row.digit_bits.data(), row.digits, first, count, out);
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

// Loads the integers of component c, padded with the last one. `carry`: the one before.
HWY_INLINE void load_integers(const StreamTask& task, std::size_t c, std::size_t first,
                              std::size_t count, std::uint32_t& carry, Numbers& out) {
  const auto prediction = static_cast<Prediction>(task.row->prediction);
  if (prediction == Prediction::kPlain) {
    load_component<false>(task, c, first, count, out);
  } else {
    load_component<true>(task, c, first, count, out);
  }
  if (prediction == Prediction::kDelta) carry = running_sums(carry, out);
  if (count < kBlock) std::fill(out + count, out + kBlock, out[count - 1]);
}

// Returns whether all values of these planes are 0.
HWY_INLINE bool all_zero(const Plane* planes, std::size_t count) {
  return std::all_of(planes, planes + count,
                     [](const Plane& p) { return p.symbols == nullptr && p.only == 0; });
}

// Stores what later streams of the same primitives depend on.
HWY_INLINE void keep(Attribute attribute, const Numbers* q, std::size_t at, MapRun& run) {
  if (attribute == Attribute::kSigma) std::copy_n(q[0], kBlock, run.sigma + at);
  if (attribute == Attribute::kRadius) std::copy_n(q[0], kBlock, run.radius + at);
  if (attribute != Attribute::kLogScale) return;
  for (std::size_t i = 0; i < kBlock; ++i) {
    const auto x = static_cast<std::int32_t>(q[0][i]), y = static_cast<std::int32_t>(q[1][i]),
               z = static_cast<std::int32_t>(q[2][i]);
    run.spread[at + i] = static_cast<std::uint32_t>(std::max(std::max(x, y), z)) -
                         static_cast<std::uint32_t>(std::min(std::min(x, y), z));
  }
}

// Fetches some of the SH rows of a run into the cache.
HWY_INLINE void fetch_sh(MapRun& run) {
  constexpr int kLines = 8;  // 24 calls, one for each component, fetch the rows of a block
  constexpr std::ptrdiff_t kFloats = 64 / sizeof(float);
  for (int k = 0; k < kLines && run.sh < run.sh_end; ++k, run.sh += kFloats)
    __builtin_prefetch(run.sh, 1);
}

// Maps the values [begin, end) of a stream of floats or integers. `carry`: the sum of the values
// before `begin`; updated to that before `end`.
bool map_values(const StreamTask& task, const SegmentContext& context, std::size_t begin,
                std::size_t end, std::uint32_t* carry, MapRun& run, Gaussians4D& set) {
  const StreamRow& row = *task.row;
  const auto attribute = static_cast<Attribute>(row.attribute);
  const auto mapping = static_cast<Mapping>(row.mapping);
  const AttributeView<float> view = view_of(set, attribute);
  const auto base = static_cast<float>(
      mapping == Mapping::kTime ? time_base(context.begin, row.step) - context.time_origin : 0.0);
  const bool rotation = mapping == Mapping::kRotation || mapping == Mapping::kShapedRotation;
  const bool together = rotation || mapping == Mapping::kColour;
  const std::size_t width = rotation ? 4 : row.components;
  HWY_ALIGN Numbers q[3];
  HWY_ALIGN Floats floats[kMaxComponents], steps;
  HWY_ALIGN int exponents[kBlock];
  Range range(max_steps(mapping, row.step.multiplier));
  bool good = true;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t count = std::min(kBlock, end - first), at = first - begin;
    if (rotation) rotation_exponents(row, context, run.spread + at, exponents);
    if (mapping == Mapping::kDisplacement)
      displacement_steps(row, run.sigma + at, run.radius + at, context.part_exponent, steps);
    for (std::size_t c = 0; c < row.components; ++c) {
      if (c % 3 == 0 && mapping == Mapping::kColour &&
          all_zero(task.planes + c * row.digits, std::size_t{3} * row.digits)) {
        std::fill(&floats[c][0], &floats[c][0] + 3 * kBlock, 0.0f);
        c += 2;
        continue;
      }
      Numbers& block = q[c % 3];
      fetch_sh(run);
      load_integers(task, c, first, count, carry[c], block);
      if (!together) {
        good &= map_component(row, c, base, steps, block, range, floats[c]);
      } else if (c % 3 == 2) {
        good &= map_three(row, exponents, q, range, floats + (c - 2));
      }
    }
    keep(attribute, q, at, run);
    if (attribute == Attribute::kSh0) {
      store_sh0(floats, count, view.data + first * view.stride, view.stride);
    } else if (task.members.empty()) {
      store_all(floats, width, count, view.data + first * view.stride, view.stride);
    } else {
      const std::uint32_t* const members = task.members.data() + first;
      store_wide(floats, width, count,
                 [&](std::size_t i) { return view.data + members[i] * view.stride; });
    }
  }
  return good && (mapping == Mapping::kFloat || range.good());
}

// As above for positions in Morton order (spec 8.4).
bool map_keys(const StreamTask& task, std::size_t begin, std::size_t end, std::uint32_t* carry,
              Gaussians4D& set) {
  const StreamRow& row = *task.row;
  const std::size_t low_digits = row.low_digits();
  const std::uint8_t low_bits[] = {8, 8};
  HWY_ALIGN Numbers keys, q;
  HWY_ALIGN Floats floats[3];
  const float step = size_of(row.step);
  Range range(max_steps(Mapping::kLinear, row.step.multiplier));
  std::uint32_t overflow = *carry;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t count = std::min(kBlock, end - first);
    load_component<false>(task, 0, first, count, keys);
    for (const std::uint32_t v : keys) overflow |= v;
    *carry = running_sums(*carry, keys);
    for (const std::uint32_t key : keys) overflow |= key;
    const Plane* planes = task.planes + row.digits;
    for (std::size_t axis = 0; axis < 3; ++axis, planes += low_digits) {
      load<false>(planes, low_bits, low_digits, first, count, q);
      for (std::size_t i = 0; i < kBlock; ++i) {
        const std::uint32_t position = q[i] + (compact3(keys[i] >> axis) << row.low);
        range.add(i, position);
        floats[axis][i] = row.origin[axis] + step * to_float(position);
      }
    }
    store_three(floats, count, set.position.data() + 3 * first, 3);
  }
  return range.good() && overflow >> (3 * kKeyBits) == 0;
}

bool map_task(const StreamTask& task, const SegmentContext& context, std::size_t begin,
              std::size_t end, std::uint32_t* carry, MapRun& run, Gaussians4D& set) {
  if (static_cast<Prediction>(task.row->prediction) == Prediction::kMorton)
    return map_keys(task, begin, end, carry, set);
  return map_values(task, context, begin, end, carry, run, set);
}

void sum_task(const StreamTask& task, std::size_t begin, std::size_t end, std::uint32_t* sums) {
  const StreamRow& row = *task.row;
  const bool keys = static_cast<Prediction>(row.prediction) == Prediction::kMorton;
  HWY_ALIGN Numbers q;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t count = std::min(kBlock, end - first);
    for (std::size_t c = 0; c < row.components; ++c) {
      if (keys) {
        load_component<false>(task, c, first, count, q);
      } else {
        load_component<true>(task, c, first, count, q);
      }
      std::uint32_t sum = 0;
      for (const std::uint32_t v : q) sum += v;
      sums[c] += sum;
    }
  }
}

bool all_finite(const FloatArray& values, std::size_t begin, std::size_t end) {
  std::uint32_t bad = 0;
  const float* const v = values.data();
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(v[i]) & 0x7F800000;
    bad |= bits == 0x7F800000 ? 1u : 0u;
  }
  return bad == 0;
}

// Returns whether no primitive has a quaternion of length 0.
bool all_turned(const float* rotation, std::size_t begin, std::size_t end) {
  std::uint32_t bad = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const float* const q = rotation + 4 * i;
    bad |= q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f ? 1u : 0u;
  }
  return bad == 0;
}

bool all_renderable(const Gaussians4D& set, std::uint32_t attributes, std::uint32_t floats,
                    std::size_t begin, std::size_t end) {
  const auto is_in = [](std::uint32_t bits, Attribute attribute) {
    return (bits & attribute_bit(attribute)) != 0;
  };
  const float *const sigma = set.sigma.data(), *const radius = set.radius.data();
  std::uint32_t bad = 0;
  for (std::size_t i = begin; is_in(attributes, Attribute::kSigma) && i < end; ++i)
    bad |= sigma[i] > 0.0f ? 0u : 1u;
  for (std::size_t i = begin; is_in(attributes, Attribute::kRadius) && i < end; ++i)
    bad |= radius[i] >= 0.0f ? 0u : 1u;
  // Mapped rotations have w > 0, or components out of range.
  if (is_in(floats, Attribute::kRotation) && !all_turned(set.rotation.data(), begin, end)) bad = 1;
  const auto finite = [&](Attribute attribute, const FloatArray& values, std::size_t width) {
    return !is_in(floats, attribute) || all_finite(values, width * begin, width * end);
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
              std::size_t end, std::uint32_t* carry, MapRun& run, Gaussians4D& set) {
  return HWY_DYNAMIC_DISPATCH(map_task)(task, context, begin, end, carry, run, set);
}

void sum_task(const StreamTask& task, std::size_t begin, std::size_t end, std::uint32_t* sums) {
  HWY_DYNAMIC_DISPATCH(sum_task)(task, begin, end, sums);
}

bool all_renderable(const Gaussians4D& set, std::uint32_t attributes, std::uint32_t floats,
                    std::size_t begin, std::size_t end) {
  return HWY_DYNAMIC_DISPATCH(all_renderable)(set, attributes, floats, begin, end);
}

}  // namespace stgs
#endif
