// SPDX-License-Identifier: Apache-2.0
// Which tiles and pixels a splat's ellipse meets. All of it may only err towards meeting: what is
// listed where it is not seen costs time, what is missing is wrong.
#pragma once

#include "cuda/draw.h"

namespace stgs::player::cuda {

inline constexpr float kLog2Threshold = -7.99435344f;  // log2(kAlphaThreshold)
// Added to the limit of half squared distances, as raster_bin.cpp adds 1e-4 to their double.
inline constexpr float kLimitSlack = 0.75e-4f;

struct Quad {
  float4 a, b, c;
};

__device__ inline ScreenSplat splat_of(const Quad& q) {
  return {q.a.x, q.a.y, q.a.z, q.a.w, q.b.x, q.b.y, q.b.z, q.b.w, q.c.x, q.c.y, q.c.z, q.c.w};
}

__device__ inline Quad load_quad(const ScreenSplat* splats, std::uint32_t i) {
  const float4* const at = reinterpret_cast<const float4*>(splats + i);
  return {__ldg(at), __ldg(at + 1), __ldg(at + 2)};
}

// The ellipse as rows of tiles see it. With v the offset from the centre in half heights, its
// points at v are x + slope v +- width sqrt(1 - v^2): the farthest right is at v = top, left at
// -top.
struct Footprint {
  float x, y, per_height, slope, width, top, slack;
  int row, rows;  // of tiles
  int view;
};

__device__ inline float kept(float x, float low, float high) {
  return fminf(fmaxf(x, low), high);
}

__device__ inline Footprint footprint_of(const ScreenSplat& s, int number, const ViewInput& view) {
  Footprint f;
  f.view = number;
  f.x = s.x;
  f.y = s.y;
  f.per_height = 1.0f / fmaxf(s.extent_y, 1e-4f);
  // The blend's rounding error grows with the elongation, half_xx extent_x^2 over the limit.
  const float limit = fmaxf(s.most - kLog2Threshold, 0.0f) + kLimitSlack -
                      4e-6f * s.half_xx * s.extent_x * s.extent_x;
  f.width = sqrtf(limit / -s.half_xx);
  f.slope = -0.5f * s.cross / s.half_xx * fmaxf(s.extent_y, 1e-4f);
  const float ratio = f.slope / f.width;
  f.top = ratio * rsqrtf(1.0f + ratio * ratio);
  if (!(fabsf(f.top) <= 1.0f)) f.top = copysignf(1.0f, ratio);  // a square that overflowed
  f.slack = 1e-3f + 2e-6f * (fabsf(f.slope) + f.width + fabsf(s.x));
  const float slack = 1e-3f + 2e-6f * (s.extent_y + fabsf(s.y));
  constexpr float kTile = kTilePixels;
  const auto count = static_cast<float>(view.tiles_y);
  const float first = ceilf((s.y - s.extent_y - slack - (kTile - 0.5f)) / kTile);
  const float last = floorf((s.y + s.extent_y + slack - 0.5f) / kTile);
  f.row = static_cast<int>(kept(first, 0.0f, count));
  f.rows = static_cast<int>(kept(last, -1.0f, count - 1.0f)) - f.row + 1;
  if (f.rows < 0) f.rows = 0;
  return f;
}

// Tiles [first, first + count) of a row.
struct Span {
  int first, count;
};

__device__ inline Span span_of(const Footprint& f, int row, const ViewInput& view) {
  constexpr float kTile = kTilePixels;
  const float top = static_cast<float>(row) * kTile + 0.5f;
  const float bottom = fminf(top + (kTile - 1.0f), static_cast<float>(view.height) - 0.5f);
  const float low = kept((top - f.y) * f.per_height, -1.0f, 1.0f);
  const float high = kept((bottom - f.y) * f.per_height, -1.0f, 1.0f);
  const float at_right = kept(f.top, low, high), at_left = kept(-f.top, low, high);
  // 1e-6 for the rounding of v, which counts most near the ends.
  const float right = f.x + f.slope * at_right +
                      f.width * sqrtf(fmaxf(1.0f - at_right * at_right, 0.0f) + 1e-6f) + f.slack;
  const float left = f.x + f.slope * at_left -
                     f.width * sqrtf(fmaxf(1.0f - at_left * at_left, 0.0f) + 1e-6f) - f.slack;
  const auto count = static_cast<float>(view.tiles_x);
  const float first = kept(ceilf((left - (kTile - 0.5f)) / kTile), 0.0f, count);
  const float last = kept(floorf((right - 0.5f) / kTile), -1.0f, count - 1.0f);
  const int n = static_cast<int>(last) - static_cast<int>(first) + 1;
  return {static_cast<int>(first), n > 0 ? n : 0};
}

// Least -log2 of falloff on the segment where one offset is `fixed` and the other in [low, high],
// less the rounding error that the blend may make there (raster_bin.cpp).
__device__ inline float edge_minimum(float across, float cross, float along, float fixed, float low,
                                     float high) {
  const float best = __fdividef(-0.5f * cross * fixed, along);
  const float free = kept(best, low, high);
  const float a = across * fixed * fixed, b = along * free * free, c = cross * fixed * free;
  return a + b + c - 1e-6f * (a + b + fabsf(c));
}

// Whether any point of the rectangle [x0,x1] x [y0,y1] of pixel centres lies in the ellipse.
__device__ inline bool meets(const Quad& q, float x0, float x1, float y0, float y1) {
  x0 -= q.a.x;
  x1 -= q.a.x;
  y0 -= q.a.y;
  y1 -= q.a.y;
  const bool in_x = x0 <= 0.0f && x1 >= 0.0f, in_y = y0 <= 0.0f && y1 >= 0.0f;
  if (in_x && in_y) return true;
  const float limit = q.b.y - kLog2Threshold + kLimitSlack;
  const float xx = -q.a.z, xy = -q.a.w, yy = -q.b.x;
  // A convex form is least on an edge that faces its centre.
  if (!in_x && edge_minimum(xx, xy, yy, x0 > 0.0f ? x0 : x1, y0, y1) <= limit) return true;
  return !in_y && edge_minimum(yy, xy, xx, y0 > 0.0f ? y0 : y1, x0, x1) <= limit;
}

}  // namespace stgs::player::cuda
