// SPDX-License-Identifier: Apache-2.0
// Blending a tile on the vector unit: splat by splat, each over the rows and columns of its box,
// with several pixels of a row at once.
#include <algorithm>
#include <cmath>

#include "raster/tile_work.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raster/blend_vector.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h, which includes this file once per target.
#include "stgs/format/raster_simd-inl.h"

HWY_BEFORE_NAMESPACE();
namespace stgs::raster::HWY_NAMESPACE {
namespace {

using IntRow = hn::RebindToSigned<Row>;

// List entries between prefetching a splat and using it.
constexpr int kAhead = 6;

// State of a tile's pixels. The transmittance of a finished pixel is negated, so that no further
// splat passes the test against kTransmittanceMin.
struct Tile {
  HWY_ALIGN float transmittance[kTileSize * kTileSize];
  HWY_ALIGN float red[kTileSize * kTileSize];
  HWY_ALIGN float green[kTileSize * kTileSize];
  HWY_ALIGN float blue[kTileSize * kTileSize];
  HWY_ALIGN float depth[kTileSize * kTileSize];
  HWY_ALIGN std::int32_t last[kTileSize * kTileSize];
  std::uint32_t rows_left;  // bit y: row y has unfinished pixels

  void begin(int width, int height) {
    for (float* sum : {red, green, blue, depth}) std::fill_n(sum, kTileSize * kTileSize, 0.0f);
    std::fill_n(last, kTileSize * kTileSize, 0);
    for (int y = 0; y < kTileSize; ++y) {
      for (int x = 0; x < kTileSize; ++x)
        transmittance[y * kTileSize + x] = x < width && y < height ? 1.0f : -1.0f;
    }
    rows_left = (1u << height) - 1u;
  }

  HWY_INLINE void update_row(int y) {
    const Row d;
    for (int x = 0; x < kTileSize; x += static_cast<int>(hn::Lanes(d))) {
      const RowVec left = hn::Load(d, transmittance + y * kTileSize + x);
      if (!hn::AllTrue(d, hn::Lt(left, hn::Zero(d)))) return;
    }
    rows_left &= ~(1u << y);
  }
};

// Blends splat s, list entry k - 1, into one vector of row y. Returns whether it finished a pixel.
HWY_INLINE bool blend_row(const RowSplat& r, const Splat& s, int k, int y, int at, Tile& tile) {
  const Row d;
  const IntRow di;
  const RowVec log2 = row_log2(r, row_offset(r, y));
  const RowMask visible = row_seen(log2);
  if (hn::AllFalse(d, visible)) return false;
  const RowVec alpha = hn::Min(hn::Set(d, math::kAlphaMax), exp2_of(log2));
  const RowVec left = hn::Load(d, tile.transmittance + at);
  const RowVec next = hn::NegMulAdd(alpha, left, left);
  const RowMask enough = hn::Ge(next, hn::Set(d, math::kTransmittanceMin));
  const RowMask blended = hn::And(visible, enough);
  const RowVec weight = hn::IfThenElseZero(blended, hn::Mul(alpha, left));
  const auto add = [&](float* sum, float value) HWY_ATTR {
    hn::Store(hn::MulAdd(weight, hn::Set(d, value), hn::Load(d, sum + at)), d, sum + at);
  };
  add(tile.red, s.colour.x);
  add(tile.green, s.colour.y);
  add(tile.blue, s.colour.z);
  add(tile.depth, s.depth);
  const auto last = hn::Load(di, tile.last + at);
  hn::Store(hn::IfThenElse(hn::RebindMask(di, blended), hn::Set(di, k), last), di, tile.last + at);
  const RowMask stopped = hn::And(hn::AndNot(enough, visible), hn::Gt(left, hn::Zero(d)));
  hn::Store(hn::IfThenElse(blended, next, hn::IfThenElse(stopped, hn::Neg(left), left)), d,
            tile.transmittance + at);
  return !hn::AllFalse(d, stopped);
}

void write_tile(const Tile& tile, const TileWork& work, const SplatFrame& frame,
                const RasterSettings& settings, RasterOutput& output) {
  const PixelBox& box = work.pixels;
  for (int y = box.y0; y < box.y1; ++y) {
    const std::size_t first = static_cast<std::size_t>(y) * frame.width + box.x0;
    const int row = ((y - box.y0) >> work.halvings) * kTileSize;
    float* red = output.colour.plane(0) + first;
    float* green = output.colour.plane(1) + first;
    float* blue = output.colour.plane(2) + first;
    for (int x = 0; x < box.x1 - box.x0; ++x) {
      const int at = row + (x >> work.halvings);
      const float left = std::abs(tile.transmittance[at]), alpha = 1.0f - left;
      red[x] = tile.red[at] + left * settings.background.x;
      green[x] = tile.green[at] + left * settings.background.y;
      blue[x] = tile.blue[at] + left * settings.background.z;
      output.alpha.data[first + x] = alpha;
      output.depth.data[first + x] = alpha > 0.0f ? tile.depth[at] / alpha : 0.0f;
      output.transmittance.data[first + x] = left;
      output.last[first + x] = static_cast<std::uint32_t>(tile.last[at]);
    }
  }
}

// Blends the n loaded entries of a list, of which the first is entry `first`.
void blend_entries(const TileWork& work, int first, int n, Tile& tile) {
  const int lanes = static_cast<int>(hn::Lanes(Row()));
  const PixelBox& box = work.box;
  for (int k = 0; k < n && tile.rows_left != 0; ++k) {
    const Splat& s = work.splats[work.list[k]];
    prefetch(work.splats, work.list, k + kAhead, n);
    const PixelBox covered = covered_pixels(s, box);
    const std::uint32_t rows_left = tile.rows_left;
    for (int x = (covered.x0 - box.x0) / lanes * lanes; x < covered.x1 - box.x0; x += lanes) {
      const RowSplat r = row_splat(s, box.x0 + x);
      for (int y = covered.y0; y < covered.y1; ++y) {
        const int row = y - box.y0;
        if (!(rows_left >> row & 1u)) continue;
        if (blend_row(r, s, first + k + 1, y, row * kTileSize + x, tile)) tile.update_row(row);
      }
    }
  }
}

void blend_tile(const SplatFrame& frame, const RasterSettings& settings, int tile_index,
                RasterOutput& output) {
  TileWork work(frame, settings, tile_index);
  Tile tile;
  tile.begin(work.box.x1 - work.box.x0, work.box.y1 - work.box.y0);
  for (int first = 0; first < work.count && tile.rows_left != 0;) {
    const int n = work.load(first);
    blend_entries(work, first, n, tile);
    first += n;
  }
  write_tile(tile, work, frame, settings, output);
}

const char* target_name() {
  return hwy::TargetName(HWY_TARGET);
}

}  // namespace
}  // namespace stgs::raster::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::raster {

HWY_EXPORT(blend_tile);
HWY_EXPORT(target_name);

void blend_tile_vector(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output) {
  HWY_DYNAMIC_DISPATCH(blend_tile)(frame, settings, tile, output);
}

std::string blend_vector_target() {
  return HWY_DYNAMIC_DISPATCH(target_name)();
}

}  // namespace stgs::raster
#endif
