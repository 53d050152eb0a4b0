// SPDX-License-Identifier: Apache-2.0
// Storing blocks of floats, one row per component, as one row per primitive. Include after
// hwy/foreach_target.h, once per target.
#if defined(STGS_STORE_FLOATS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef STGS_STORE_FLOATS_INL_H
#undef STGS_STORE_FLOATS_INL_H
#else
#define STGS_STORE_FLOATS_INL_H
#endif

#include <cstddef>
#include <cstdint>

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stgs::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kBlock = 64;  // primitives; their SH fit into the cache
using Floats = float[kBlock];

// Stores kCount floats of each primitive.
template <std::size_t kCount>
HWY_INLINE void store(const Floats* from, std::size_t count, float* to, std::size_t stride) {
  for (std::size_t i = 0; i < count; ++i, to += stride) {
    for (std::size_t c = 0; c < kCount; ++c) to[c] = from[c][i];
  }
}

// Transposes four floats of four primitives, from one row per component to one per primitive.
HWY_INLINE void store_square(const Floats* from, std::size_t i, float* to, std::size_t stride) {
#if HWY_TARGET == HWY_SCALAR
  for (std::size_t k = 0; k < 4; ++k, to += stride) {
    for (std::size_t c = 0; c < 4; ++c) to[c] = from[c][i + k];
  }
#else
  const hn::FixedTag<float, 4> f;
  const hn::FixedTag<std::uint64_t, 2> two;
  const auto a = hn::Load(f, from[0] + i), b = hn::Load(f, from[1] + i);
  const auto c = hn::Load(f, from[2] + i), d = hn::Load(f, from[3] + i);
  const auto ab = hn::BitCast(two, hn::InterleaveLower(f, a, b));
  const auto cd = hn::BitCast(two, hn::InterleaveLower(f, c, d));
  const auto ab_high = hn::BitCast(two, hn::InterleaveUpper(f, a, b));
  const auto cd_high = hn::BitCast(two, hn::InterleaveUpper(f, c, d));
  hn::StoreU(hn::BitCast(f, hn::InterleaveLower(two, ab, cd)), f, to);
  hn::StoreU(hn::BitCast(f, hn::InterleaveUpper(two, ab, cd)), f, to + stride);
  hn::StoreU(hn::BitCast(f, hn::InterleaveLower(two, ab_high, cd_high)), f, to + 2 * stride);
  hn::StoreU(hn::BitCast(f, hn::InterleaveUpper(two, ab_high, cd_high)), f, to + 3 * stride);
#endif
}

// Stores `width` >= 4 floats of each primitive. The last four may overlap the previous ones.
HWY_INLINE void store_wide(const Floats* from, std::size_t width, std::size_t count, float* to,
                           std::size_t stride) {
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4, to += 4 * stride) {
    for (std::size_t c = 0; c + 4 < width; c += 4) store_square(from + c, i, to + c, stride);
    store_square(from + width - 4, i, to + width - 4, stride);
  }
  for (; i < count; ++i, to += stride) {
    for (std::size_t c = 0; c < width; ++c) to[c] = from[c][i];
  }
}

// Stores `width` floats of each of `count` primitives, 1, 3 or at least 4.
HWY_INLINE void store_all(const Floats* from, std::size_t width, std::size_t count, float* to,
                          std::size_t stride) {
  if (width == 1) return store<1>(from, count, to, stride);
  if (width == 3) return store<3>(from, count, to, stride);
  store_wide(from, width, count, to, stride);
}

}  // namespace
}  // namespace stgs::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
