// SPDX-License-Identifier: Apache-2.0
// Storing blocks of floats, one row per component, as one row per primitive. Include after
// hwy/foreach_target.h, once per target.
#if defined(STGS_STORE_FLOATS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef STGS_STORE_FLOATS_INL_H
#undef STGS_STORE_FLOATS_INL_H
#else
#define STGS_STORE_FLOATS_INL_H
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stgs::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kBlock = 64;  // primitives; their SH fit into the cache
using Floats = float[kBlock];

// Stores one float of each primitive.
HWY_INLINE void store_one(const Floats& from, std::size_t count, float* to) {
  if (count == kBlock) {
    std::memcpy(to, from, sizeof(Floats));  // of constant size: a few vectors
  } else {
    std::memcpy(to, from, count * sizeof(float));
  }
}

// Stores three floats of each primitive, `stride` apart.
HWY_INLINE void store_three(const Floats* from, std::size_t count, float* to, std::size_t stride) {
  std::size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::CappedTag<float, 8> d;
  constexpr std::size_t kLanes = hn::MaxLanes(d);
  for (; stride == 3 && i + kLanes <= count; i += kLanes, to += 3 * kLanes) {
    hn::StoreInterleaved3(hn::Load(d, from[0] + i), hn::Load(d, from[1] + i),
                          hn::Load(d, from[2] + i), d, to);
  }
#endif
  for (; i < count; ++i, to += stride) {
    for (std::size_t c = 0; c < 3; ++c) to[c] = from[c][i];
  }
}

// Transposes four floats of four primitives, from one row per component to one per primitive.
HWY_INLINE void store_square(const Floats* from, std::size_t i, float* const (&to)[4],
                             std::size_t column) {
#if HWY_TARGET == HWY_SCALAR
  for (std::size_t k = 0; k < 4; ++k) {
    for (std::size_t c = 0; c < 4; ++c) to[k][column + c] = from[c][i + k];
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
  hn::StoreU(hn::BitCast(f, hn::InterleaveLower(two, ab, cd)), f, to[0] + column);
  hn::StoreU(hn::BitCast(f, hn::InterleaveUpper(two, ab, cd)), f, to[1] + column);
  hn::StoreU(hn::BitCast(f, hn::InterleaveLower(two, ab_high, cd_high)), f, to[2] + column);
  hn::StoreU(hn::BitCast(f, hn::InterleaveUpper(two, ab_high, cd_high)), f, to[3] + column);
#endif
}

template <std::size_t kStride>
using RowTag = hn::CappedTag<float, (kStride < 16 ? 8 : 16)>;

// Sets kStride floats to 0, in stores that the compiler does not replace by a call.
template <std::size_t kStride, std::size_t... k>
HWY_INLINE void clear_row(float* row, std::index_sequence<k...>) {
  const RowTag<kStride> d;
  (hn::StoreU(hn::Zero(d), d, row + std::min(k * hn::MaxLanes(d), kStride - hn::MaxLanes(d))), ...);
}

// Stores three floats of each primitive and sets the others of its row of kStride to 0. Uses a
// fourth component of `from`.
template <std::size_t kStride>
HWY_INLINE void store_first_three(Floats* from, std::size_t count, float* to) {
  constexpr std::size_t kLanes = hn::MaxLanes(RowTag<kStride>());
  const std::make_index_sequence<(kStride + kLanes - 1) / kLanes> stores;
  std::fill_n(from[3], kBlock, 0.0f);
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4, to += 4 * kStride) {
    float* const rows[4] = {to, to + kStride, to + 2 * kStride, to + 3 * kStride};
    for (float* const row : rows) clear_row<kStride>(row, stores);
    store_square(from, i, rows, 0);
  }
  for (; i < count; ++i, to += kStride) {
    clear_row<kStride>(to, stores);
    for (std::size_t c = 0; c < 3; ++c) to[c] = from[c][i];
  }
}

// Stores the SH of degree 0, and sets those above to 0.
HWY_INLINE void store_sh0(Floats* from, std::size_t count, float* to, std::size_t stride) {
  if (stride == 12) return store_first_three<12>(from, count, to);
  if (stride == 27) return store_first_three<27>(from, count, to);
  if (stride == 48) return store_first_three<48>(from, count, to);
  store_three(from, count, to, stride);
}

// Stores `width` >= 4 floats of each primitive, those of primitive i at row(i). The last four may
// overlap the previous ones.
template <typename Row>
HWY_INLINE void store_wide(const Floats* from, std::size_t width, std::size_t count,
                           const Row& row) {
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    float* const to[4] = {row(i), row(i + 1), row(i + 2), row(i + 3)};
    for (std::size_t c = 0; c + 4 < width; c += 4) store_square(from + c, i, to, c);
    store_square(from + width - 4, i, to, width - 4);
  }
  for (; i < count; ++i) {
    for (std::size_t c = 0; c < width; ++c) row(i)[c] = from[c][i];
  }
}

// Stores `width` floats of each of `count` primitives, 1, 3 or at least 4. `stride` is 1 if the
// width is.
HWY_INLINE void store_all(const Floats* from, std::size_t width, std::size_t count, float* to,
                          std::size_t stride) {
  if (width == 1) return store_one(from[0], count, to);
  if (width == 3) return store_three(from, count, to, stride);
  store_wide(from, width, count, [&](std::size_t i) { return to + i * stride; });
}

}  // namespace
}  // namespace stgs::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
