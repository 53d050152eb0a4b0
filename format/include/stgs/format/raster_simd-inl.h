// SPDX-License-Identifier: Apache-2.0
// The alpha law over a vector of pixels, shared by the forward and the backward kernel so that both
// draw exactly the same. For use after hwy/foreach_target.h, once a target.
#if defined(STGS_RASTER_SIMD_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef STGS_RASTER_SIMD_INL_H
#undef STGS_RASTER_SIMD_INL_H
#else
#define STGS_RASTER_SIMD_INL_H
#endif

#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#include "stgs/format/math/blend.h"
#include "stgs/format/raster_tiles.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::raster::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A row of a tile in one vector, or in several where the machine's are shorter.
using Row = hn::CappedTag<float, kTileSize>;
using RowVec = hn::Vec<Row>;
using RowMask = hn::Mask<Row>;

// One splat over a row's columns: half squared distance = base + dy (cross + half_yy dy).
struct RowSplat {
  RowVec dx, base, cross, half_yy, mean_y, reach, opacity;
};

// `x` is the first pixel of the row's vector.
HWY_INLINE RowSplat row_splat(const Splat& s, int x) {
  const Row d;
  RowSplat r;
  const RowVec centre = hn::Set(d, static_cast<float>(x) + 0.5f - s.mean.x);
  r.dx = hn::Add(hn::Iota(d, 0.0f), centre);
  r.base = hn::Mul(hn::Mul(hn::Set(d, 0.5f * s.conic.xx), r.dx), r.dx);
  r.cross = hn::Mul(hn::Set(d, s.conic.xy), r.dx);
  r.half_yy = hn::Set(d, 0.5f * s.conic.yy);
  r.mean_y = hn::Set(d, s.mean.y);
  // Over the reach by more than rounding: alpha itself decides at the edge.
  r.reach = hn::Set(d, s.reach + 1e-4f);
  r.opacity = hn::Set(d, s.opacity);
  return r;
}

// Vertical offset of row y.
HWY_INLINE RowVec row_offset(const RowSplat& r, int y) {
  return hn::Sub(hn::Set(Row(), static_cast<float>(y) + 0.5f), r.mean_y);
}

HWY_INLINE RowVec row_power(const RowSplat& r, RowVec dy) {
  return hn::MulAdd(dy, hn::MulAdd(r.half_yy, dy, r.cross), r.base);
}

// opacity exp(-power), before it is cut at kAlphaMax.
HWY_INLINE RowVec row_falloff(const RowSplat& r, RowVec power) {
  const Row d;
  return hn::Mul(r.opacity, hn::Exp(d, hn::Neg(hn::Max(power, hn::Zero(d)))));
}

}  // namespace stgs::raster::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
