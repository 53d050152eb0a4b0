// SPDX-License-Identifier: Apache-2.0
// SIMD backward pass over a tile: the loops of the forward pass in reverse.
#include <algorithm>

#include "backend/cpu/blend_backward_kernels.h"
#include "stgs/format/raster_tiles.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "backend/cpu/blend_backward_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include "stgs/format/raster_simd-inl.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::cpu::HWY_NAMESPACE {
namespace {

namespace simd = stgs::raster::HWY_NAMESPACE;
namespace hn = hwy::HWY_NAMESPACE;
using simd::Row;
using simd::RowMask;
using simd::RowVec;
using IntRow = hn::RebindToSigned<Row>;

// Prefetch distance, list entries.
constexpr int kPrefetch = 6;
constexpr int kPixels = kTileSize * kTileSize;

// State of a tile's pixels. Pixels beyond the image's edge have last = 0 and do not contribute.
struct Tile {
  HWY_ALIGN float transmittance[kPixels];  // in front of the processed splats, back to front
  HWY_ALIGN float behind[kPixels];         // dL/dcolour . (colour behind the splat)
  HWY_ALIGN float red[kPixels];            // dL/dcolour
  HWY_ALIGN float green[kPixels];
  HWY_ALIGN float blue[kPixels];
  HWY_ALIGN float error[kPixels];
  HWY_ALIGN float surface[4][kPixels];  // dL/d(blended normal, distance); only with planes
  HWY_ALIGN std::int32_t last[kPixels];
  int row_last[kTileSize];  // the largest `last` of each row
  int tile_last = 0;        // and of the tile
};

void load_tile(const TileBackward& t, const raster::PixelBox& box, Tile& tile) {
  std::fill_n(tile.last, kPixels, 0);
  std::fill_n(tile.row_last, kTileSize, 0);
  for (float* plane :
       {tile.transmittance, tile.behind, tile.red, tile.green, tile.blue, tile.error})
    std::fill_n(plane, kPixels, 0.0f);
  const math::Vec3 background = t.settings.background;
  for (int y = box.y0; y < box.y1; ++y) {
    const std::size_t first = static_cast<std::size_t>(y) * t.frame.width + box.x0;
    const int row = y - box.y0, at = row * kTileSize, n = box.x1 - box.x0;
    std::copy_n(t.forward.transmittance.data.data() + first, n, tile.transmittance + at);
    std::copy_n(t.d_colour.plane(0) + first, n, tile.red + at);
    std::copy_n(t.d_colour.plane(1) + first, n, tile.green + at);
    std::copy_n(t.d_colour.plane(2) + first, n, tile.blue + at);
    if (t.error) std::copy_n(t.error->data.data() + first, n, tile.error + at);
    for (int x = 0; x < n; ++x) {
      tile.behind[at + x] = tile.red[at + x] * background.x + tile.green[at + x] * background.y +
                            tile.blue[at + x] * background.z;
      tile.last[at + x] = static_cast<std::int32_t>(t.forward.last[first + x]);
      tile.row_last[row] = std::max(tile.row_last[row], tile.last[at + x]);
    }
    tile.tile_last = std::max(tile.tile_last, tile.row_last[row]);
  }
}

void load_surface(const TileBackward& t, const raster::PixelBox& box, Tile& tile) {
  for (int c = 0; c < 4; ++c) {
    std::fill_n(tile.surface[c], kPixels, 0.0f);
    const float* plane = t.planes->d_surface.plane(c);
    for (int y = box.y0; y < box.y1; ++y)
      std::copy_n(plane + static_cast<std::size_t>(y) * t.frame.width + box.x0, box.x1 - box.x0,
                  tile.surface[c] + (y - box.y0) * kTileSize);
  }
}

// Quantities summed over a splat's pixels, with g = dL/dpower and (x,y) the offset from the mean.
enum Sum {
  kRed,
  kGreen,
  kBlue,
  kWeight,
  kG,
  kGx,
  kGy,
  kError,
  kGxx,
  kGxy,
  kGyy,
  kUnused,
  kAbsX,
  kAbsY,
  kUnused2,
  kUnused3,
  kColourSums,
  kNormalX = kColourSums,  // these four only with planes
  kNormalY,
  kNormalZ,
  kDistance,
  kSums
};

// Sums over the rows of one vector of columns; the moments in x follow at the end.
struct RowSums {
  RowVec red, green, blue, weight, g, gy, gyy, error, abs_x, abs_y;
};
struct SurfaceSums {
  RowVec normal_x, normal_y, normal_z, distance;
};

// Returns a / b with a relative error below 3e-7.
HWY_INLINE RowVec divide(RowVec a, RowVec b) {
#if HWY_ARCH_X86  // at least 12 bits, doubled by a Newton step; division would stall the loop
  const RowVec r = hn::ApproximateReciprocal(b);
  return hn::Mul(a, hn::Mul(r, hn::NegMulAdd(b, r, hn::Set(Row(), 2.0f))));
#else
  return hn::Div(a, b);
#endif
}

// Accumulates a plane's gradients with these weights; returns its dL/dweight.
HWY_INLINE RowVec surface_backward(const math::Plane& plane, RowVec weight, int at,
                                   const Tile& tile, SurfaceSums& sum) {
  const Row d;
  const RowVec x = hn::Load(d, tile.surface[0] + at), y = hn::Load(d, tile.surface[1] + at);
  const RowVec z = hn::Load(d, tile.surface[2] + at), distance = hn::Load(d, tile.surface[3] + at);
  sum.normal_x = hn::MulAdd(weight, x, sum.normal_x);
  sum.normal_y = hn::MulAdd(weight, y, sum.normal_y);
  sum.normal_z = hn::MulAdd(weight, z, sum.normal_z);
  sum.distance = hn::MulAdd(weight, distance, sum.distance);
  const RowVec own =
      hn::MulAdd(z, hn::Set(d, plane.normal.z), hn::Mul(distance, hn::Set(d, plane.distance)));
  return hn::MulAdd(x, hn::Set(d, plane.normal.x), hn::MulAdd(y, hn::Set(d, plane.normal.y), own));
}

// Accumulates splat k's gradients over row y and removes the splat from the row's pixels. `plane`:
// the splat's, or null.
template <bool kPlanes>
HWY_INLINE void row_backward(const simd::RowSplat& r, const Splat& s, const math::Plane* plane,
                             int k, int y, int at, Tile& tile, RowSums& sum, SurfaceSums& surface) {
  const Row d;
  const IntRow di;
  const RowVec dy = simd::row_offset(r, y);
  const RowVec log2 = simd::row_log2(r, dy);
  const RowMask is_listed = hn::RebindMask(d, hn::Gt(hn::Load(di, tile.last + at), hn::Set(di, k)));
  const RowMask contributes = hn::And(is_listed, simd::row_seen(log2));
  if (hn::AllFalse(d, contributes)) return;
  const RowVec falloff = simd::exp2_of(log2);
  const RowVec max_alpha = hn::Set(d, math::kAlphaMax);
  const RowVec alpha = hn::IfThenElseZero(contributes, hn::Min(max_alpha, falloff));

  const RowVec transmittance =
      divide(hn::Load(d, tile.transmittance + at), hn::Sub(hn::Set(d, 1.0f), alpha));
  const RowVec weight = hn::Mul(alpha, transmittance);
  const RowVec red = hn::Load(d, tile.red + at);
  const RowVec green = hn::Load(d, tile.green + at);
  const RowVec blue = hn::Load(d, tile.blue + at);
  RowVec own =
      hn::MulAdd(red, hn::Set(d, s.colour.x),
                 hn::MulAdd(green, hn::Set(d, s.colour.y), hn::Mul(blue, hn::Set(d, s.colour.z))));
  if constexpr (kPlanes) own = hn::Add(own, surface_backward(*plane, weight, at, tile, surface));
  const RowVec behind = hn::Load(d, tile.behind + at);
  const RowVec gain = hn::Sub(own, behind);
  hn::Store(transmittance, d, tile.transmittance + at);
  hn::Store(hn::MulAdd(alpha, gain, behind), d, tile.behind + at);

  // dL/dpower = -alpha dL/dalpha; 0 if alpha is clamped at its maximum.
  const RowVec free_weight = hn::IfThenElseZero(hn::Le(falloff, max_alpha), weight);
  const RowVec g = hn::Neg(hn::Mul(free_weight, gain));
  const RowVec conic_xy = hn::Set(d, s.conic.xy);
  const RowVec slope_x = hn::MulAdd(hn::Set(d, s.conic.xx), r.dx, hn::Mul(conic_xy, dy));
  const RowVec slope_y = hn::MulAdd(hn::Set(d, s.conic.yy), dy, hn::Mul(conic_xy, r.dx));
  const RowVec gy = hn::Mul(g, dy);
  sum.red = hn::MulAdd(weight, red, sum.red);
  sum.green = hn::MulAdd(weight, green, sum.green);
  sum.blue = hn::MulAdd(weight, blue, sum.blue);
  sum.weight = hn::Add(sum.weight, weight);
  sum.error = hn::MulAdd(weight, hn::Load(d, tile.error + at), sum.error);
  sum.g = hn::Add(sum.g, g);
  sum.gy = hn::Add(sum.gy, gy);
  sum.gyy = hn::MulAdd(gy, dy, sum.gyy);
  sum.abs_x = hn::Add(sum.abs_x, hn::Abs(hn::Mul(g, slope_x)));
  sum.abs_y = hn::Add(sum.abs_y, hn::Abs(hn::Mul(g, slope_y)));
}

// Adds the sums over the lanes of a, b, c and e to out[0..3].
HWY_INLINE void add_lanes(RowVec a, RowVec b, RowVec c, RowVec e, float* HWY_RESTRICT out) {
#if HWY_TARGET == HWY_SCALAR  // one lane, nothing to interleave
  out[0] += hn::GetLane(a);
  out[1] += hn::GetLane(b);
  out[2] += hn::GetLane(c);
  out[3] += hn::GetLane(e);
#else
  const Row d;
  const hn::Repartition<double, Row> dd;
  const hn::CappedTag<float, 4> d4;
  const RowVec ab = hn::Add(hn::InterleaveLower(d, a, b), hn::InterleaveUpper(d, a, b));
  const RowVec ce = hn::Add(hn::InterleaveLower(d, c, e), hn::InterleaveUpper(d, c, e));
  const auto ab2 = hn::BitCast(dd, ab), ce2 = hn::BitCast(dd, ce);
  const RowVec all = hn::Add(hn::BitCast(d, hn::InterleaveLower(dd, ab2, ce2)),
                             hn::BitCast(d, hn::InterleaveUpper(dd, ab2, ce2)));
  HWY_ALIGN float lanes[kTileSize];
  hn::Store(all, d, lanes);
  auto total = hn::Load(d4, out);
  for (std::size_t i = 0; i < hn::Lanes(d); i += 4) total = hn::Add(total, hn::Load(d4, lanes + i));
  hn::Store(total, d4, out);
#endif
}

HWY_INLINE void add_columns(const RowSums& sum, RowVec dx, float* HWY_RESTRICT out) {
  const RowVec gx = hn::Mul(sum.g, dx), zero = hn::Zero(Row());
  add_lanes(sum.red, sum.green, sum.blue, sum.weight, out + kRed);
  add_lanes(sum.g, gx, sum.gy, sum.error, out + kG);
  add_lanes(hn::Mul(gx, dx), hn::Mul(sum.gy, dx), sum.gyy, zero, out + kGxx);
  add_lanes(sum.abs_x, sum.abs_y, zero, zero, out + kAbsX);
}

SplatGradients gradients_of(const Splat& s, const float* sums) {
  const float gx = sums[kGx], gy = sums[kGy];
  SplatGradients g;
  g.mean = {-(s.conic.xx * gx + s.conic.xy * gy), -(s.conic.xy * gx + s.conic.yy * gy)};
  g.conic = {0.5f * sums[kGxx], sums[kGxy], 0.5f * sums[kGyy]};
  g.colour = {sums[kRed], sums[kGreen], sums[kBlue]};
  g.opacity = -sums[kG] / s.opacity;
  g.abs_mean = {sums[kAbsX], sums[kAbsY]};
  g.error = sums[kError];
  g.weight = sums[kWeight];
  return g;
}

template <bool kPlanes>
void backward_tile_impl(const TileBackward& t) {
  const Row d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const raster::PixelBox box = raster::tile_pixels(t.frame, t.tile);
  const std::uint32_t first = t.frame.tile_begin[t.tile];
  const int count = static_cast<int>(t.frame.tile_begin[t.tile + 1] - first);
  const std::uint32_t* list = t.frame.instances.data() + first;
  Tile tile;
  load_tile(t, box, tile);
  if constexpr (kPlanes) load_surface(t, box, tile);
  std::fill(t.out + tile.tile_last, t.out + count, SplatGradients{});
  if constexpr (kPlanes)
    std::fill(t.plane_out + tile.tile_last, t.plane_out + count, math::Plane{});
  for (int k = tile.tile_last; k-- > 0;) {
    const Splat& s = t.frame.splats[list[k]];
    simd::prefetch(t.frame.splats.data(), list, k - kPrefetch, count);
    const raster::PixelBox covered = raster::covered_pixels(s, box);
    const math::Plane* plane = kPlanes ? &t.planes->planes[list[k]] : nullptr;
    HWY_ALIGN float sums[kPlanes ? kSums : kColourSums] = {};
    for (int x = (covered.x0 - box.x0) / lanes * lanes; x < covered.x1 - box.x0; x += lanes) {
      const simd::RowSplat r = simd::row_splat(s, box.x0 + x);
      const RowVec zero = hn::Zero(d);
      RowSums sum{zero, zero, zero, zero, zero, zero, zero, zero, zero, zero};
      SurfaceSums surface{zero, zero, zero, zero};
      for (int y = covered.y0; y < covered.y1; ++y) {
        const int row = y - box.y0;
        if (k < tile.row_last[row])
          row_backward<kPlanes>(r, s, plane, k, y, row * kTileSize + x, tile, sum, surface);
      }
      add_columns(sum, r.dx, sums);
      if constexpr (kPlanes)
        add_lanes(surface.normal_x, surface.normal_y, surface.normal_z, surface.distance,
                  sums + kNormalX);
    }
    t.out[k] = gradients_of(s, sums);
    if constexpr (kPlanes)
      t.plane_out[k] = {{sums[kNormalX], sums[kNormalY], sums[kNormalZ]}, sums[kDistance]};
  }
}

void backward_tile(const TileBackward& t) {
  t.planes != nullptr ? backward_tile_impl<true>(t) : backward_tile_impl<false>(t);
}

}  // namespace
}  // namespace stgs::encoder::cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder::cpu {

HWY_EXPORT(backward_tile);

void blend_backward_tile_vector(const TileBackward& t) {
  HWY_DYNAMIC_DISPATCH(backward_tile)(t);
}

}  // namespace stgs::encoder::cpu
#endif
