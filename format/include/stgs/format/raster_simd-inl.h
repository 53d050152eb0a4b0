// SPDX-License-Identifier: Apache-2.0
// The alpha law over a vector of pixels. Forward and backward kernel share it, so that both give
// the same result. Include after hwy/foreach_target.h, once per target.
#if defined(STGS_RASTER_SIMD_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef STGS_RASTER_SIMD_INL_H
#undef STGS_RASTER_SIMD_INL_H
#else
#define STGS_RASTER_SIMD_INL_H
#endif

#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include "stgs/format/math/screen_splat.h"
#include "stgs/format/raster_tiles.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::raster::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A row of a tile: one vector, or several if the machine's vectors are shorter.
using Row = hn::CappedTag<float, kTileSize>;
using RowVec = hn::Vec<Row>;
using RowMask = hn::Mask<Row>;

// Near-minimax polynomial of 2^f for |f| <= 1/2.
constexpr float kExp2[6] = {1.00000008f,   0.693147188f,   0.240221075f,
                            0.0555035711f, 0.00967603192f, 0.00133908634f};

// Returns 2^x for x in [-126, 0], with a relative error of at most 4e-7; unspecified elsewhere. It
// takes fewer steps than hn::Exp, because the kernels mask values out of range anyway.
HWY_INLINE RowVec exp2_of(RowVec x) {
  const Row d;
  const hn::RebindToSigned<Row> di;
  // Adding 1.5 * 2^23 puts the nearest integer into the low bits.
  const RowVec magic = hn::Set(d, 12582912.0f);
  const RowVec shifted = hn::Add(x, magic);
  const RowVec f = hn::Sub(x, hn::Sub(shifted, magic));
  RowVec sum = hn::Set(d, kExp2[5]);
  for (int k = 4; k >= 0; --k) sum = hn::MulAdd(sum, f, hn::Set(d, kExp2[k]));
  const auto exponent = hn::ShiftLeft<23>(hn::BitCast(di, shifted));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, sum), exponent));
}

// One splat over the columns of a row, with a base-2 exponent:
// log2(opacity exp(-power)) = min(base + dy (cross + half_yy dy), peak).
struct RowSplat {
  RowVec dx, base, cross, half_yy, mean_y, peak;
};

// Prepares a splat for a row. `x` is the first pixel of the row's vector. math::ScreenSplat is not
// used: Splat holds the conic, which the scalar reference evaluates.
HWY_INLINE RowSplat row_splat(const Splat& s, int x) {
  const Row d;
  const float peak = math::kLog2E * s.reach + math::kLog2Threshold;
  const math::Falloff falloff = math::falloff_of(s.conic);
  RowSplat r;
  r.dx = hn::Add(hn::Iota(d, 0.0f), hn::Set(d, static_cast<float>(x) + 0.5f - s.mean.x));
  r.peak = hn::Set(d, peak);
  r.base = hn::MulAdd(hn::Mul(hn::Set(d, falloff.xx), r.dx), r.dx, r.peak);
  r.cross = hn::Mul(hn::Set(d, falloff.xy), r.dx);
  r.half_yy = hn::Set(d, falloff.yy);
  r.mean_y = hn::Set(d, s.mean.y);
  return r;
}

// Returns the vertical offset of row y from the splat's centre.
HWY_INLINE RowVec row_offset(const RowSplat& r, int y) {
  return hn::Sub(hn::Set(Row(), static_cast<float>(y) + 0.5f), r.mean_y);
}

// Returns log2 of the splat's alpha before it is clamped to kAlphaMax.
HWY_INLINE RowVec row_log2(const RowSplat& r, RowVec dy) {
  return hn::Min(hn::MulAdd(dy, hn::MulAdd(r.half_yy, dy, r.cross), r.base), r.peak);
}

// Returns the pixels whose alpha reaches kAlphaThreshold.
HWY_INLINE RowMask row_seen(RowVec log2) {
  return hn::Ge(log2, hn::Set(Row(), math::kLog2Threshold));
}

// Prefetches the splat of list entry k. Lists refer to splats in no particular order.
HWY_INLINE void prefetch(const Splat* splats, const std::uint32_t* list, int k, int count) {
  if (k >= 0 && k < count) hwy::Prefetch(splats + list[k]);
}

}  // namespace stgs::raster::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
