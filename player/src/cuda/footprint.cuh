// SPDX-License-Identifier: Apache-2.0
// Tests which tiles, and which quarters of them, the ellipse of a splat meets. The tests are
// conservative: a false hit costs time. A missed hit is an error, except at pixels where alpha
// reaches the threshold only by rounding.
#pragma once

#include "cuda/draw.h"
#include "stgs/format/math/fovea.h"

namespace stgs::player::cuda {

// The ellipse parameterised by row. With v the offset from the centre in half heights, its points
// at v are x + slope v +- width sqrt(1 - v^2). The rightmost point is at v = top, the leftmost at
// -top.
struct Footprint {
  float x, y, per_height, slope, width, top, slack;
  int row, rows;  // of kRowPixels, see footprint_of()
  int view;
};

__device__ inline float clamped(float x, float low, float high) {
  return fminf(fmaxf(x, low), high);
}

template <int kRowPixels>
__device__ inline Footprint footprint_of(const ScreenSplat& s, int number, const ViewInput& view) {
  Footprint f;
  f.view = number;
  f.x = s.mean.x;
  f.y = s.mean.y;
  f.per_height = 1.0f / fmaxf(s.extent.y, 1e-4f);
  // The blend's rounding error grows with the elongation, falloff.xx extent.x^2 over the limit.
  const float limit = fmaxf(s.peak - math::kLog2Threshold, 0.0f) + math::kLimitSlack -
                      4e-6f * s.falloff.xx * s.extent.x * s.extent.x;
  f.width = sqrtf(limit / -s.falloff.xx);
  f.slope = -0.5f * s.falloff.xy / s.falloff.xx * fmaxf(s.extent.y, 1e-4f);
  const float ratio = f.slope / f.width;
  f.top = ratio * rsqrtf(1.0f + ratio * ratio);
  if (!(fabsf(f.top) <= 1.0f)) f.top = copysignf(1.0f, ratio);  // the square overflowed
  const float slack = 1e-3f + 2e-6f * (s.extent.y + fabsf(s.mean.y));
  f.slack = slack + 2e-6f * (fabsf(f.slope) + f.width + fabsf(s.mean.x));
  constexpr float kSide = kRowPixels;
  const auto count = static_cast<float>((view.height + kRowPixels - 1) / kRowPixels);
  const float first = ceilf((s.mean.y - s.extent.y - slack - (kSide - 0.5f)) / kSide);
  const float last = floorf((s.mean.y + s.extent.y + slack - 0.5f) / kSide);
  f.row = static_cast<int>(clamped(first, 0.0f, count));
  f.rows = static_cast<int>(clamped(last, -1.0f, count - 1.0f)) - f.row + 1;
  if (f.rows < 0) f.rows = 0;
  return f;
}

// [first, first + count).
struct Span {
  int first, count;
};

// Returns the intersection of two spans.
__device__ inline Span intersection(Span a, Span b) {
  const int first = max(a.first, b.first);
  return {first, max(min(a.first + a.count, b.first + b.count) - first, 0)};
}

__device__ inline bool has(Span span, int i) {
  return static_cast<unsigned>(i - span.first) < static_cast<unsigned>(span.count);
}

// Returns sqrt(1 - v^2); 1e-6 covers the rounding of v, which matters most near the ends.
__device__ inline float half_width(float v) {
  return __fsqrt_rn(__fadd_rn(fmaxf(__fmaf_rn(-v, v, 1.0f), 0.0f), 1e-6f));
}

// Returns the cells of kPixels x kPixels (tiles or quarters) that the ellipse meets in a row of
// them. Rounding is explicit: counting and listing must agree in every kernel.
template <int kPixels>
__device__ inline Span span_of(const Footprint& f, int row, const ViewInput& view) {
  constexpr float kSide = kPixels;
  const float top = static_cast<float>(row) * kSide + 0.5f;
  const float bottom = fminf(top + (kSide - 1.0f), static_cast<float>(view.height) - 0.5f);
  const float above = __fmul_rn(__fsub_rn(top, f.y), f.per_height);
  const float below = __fmul_rn(__fsub_rn(bottom, f.y), f.per_height);
  const float beyond = __fmaf_rn(f.slack, f.per_height, 1.0f);
  if (bottom < top || above > beyond || below < -beyond) return {0, 0};
  const float low = clamped(above, -1.0f, 1.0f), high = clamped(below, -1.0f, 1.0f);
  const float at_right = clamped(f.top, low, high), at_left = clamped(-f.top, low, high);
  const float right = __fadd_rn(
      __fmaf_rn(f.width, half_width(at_right), __fmaf_rn(f.slope, at_right, f.x)), f.slack);
  const float left = __fsub_rn(
      __fmaf_rn(-f.width, half_width(at_left), __fmaf_rn(f.slope, at_left, f.x)), f.slack);
  const auto count = static_cast<float>((view.width + kPixels - 1) / kPixels);
  const float first = clamped(ceilf((left - (kSide - 0.5f)) / kSide), 0.0f, count);
  const float last = clamped(floorf((right - 0.5f) / kSide), -1.0f, count - 1.0f);
  const int n = static_cast<int>(last) - static_cast<int>(first) + 1;
  return {static_cast<int>(first), n > 0 ? n : 0};
}

// The cells that are met in the upper and the lower half of a row: quarters of a row of tiles, or
// tiles of a row of squares of 2 x 2.
struct Cells {
  Span upper, lower;
};

// Returns the span of tiles with a quarter that is met, or of squares with a tile that is met.
__device__ inline Span tiles_of_cells(const Cells& cells) {
  const Span a = cells.upper.count > 0 ? cells.upper : cells.lower;
  const Span b = cells.lower.count > 0 ? cells.lower : a;
  const int first = min(a.first, b.first) / 2;
  const int end = (max(a.first + a.count, b.first + b.count) + 1) / 2;
  return {first, a.count > 0 ? end - first : 0};
}

// Returns which of the four cells of a tile or square are met: bit x + 2 y.
__device__ inline std::uint32_t met_of(const Cells& cells, int tile) {
  const int left = 2 * tile, right = left + 1;
  return (has(cells.upper, left) ? 1u : 0u) | (has(cells.upper, right) ? 2u : 0u) |
         (has(cells.lower, left) ? 4u : 0u) | (has(cells.lower, right) ? 8u : 0u);
}

// Returns the squares of 2 x 2 tiles in a row that are rendered at full resolution, as
// math::beyond_fovea does. Rounding is explicit: the list and the blend must agree on each square.
__device__ inline Span sharp_squares(const ViewInput& view, int row) {
  constexpr float kSquare = math::kFoveaSquare;
  const float top = static_cast<float>(row) * kSquare;
  const float dy = fmaxf(0.0f, fmaxf(top - view.fovea.y, (view.fovea.y - top) - kSquare));
  const float radius = view.fovea_radius;
  const float rest = __fsub_rn(__fmul_rn(radius, radius), __fmul_rn(dy, dy));
  if (!(rest >= 0.0f)) return {0, 0};
  const float reach = __fsqrt_rn(rest);
  const auto count = static_cast<float>((view.tiles_x + 1) / 2);
  const float first = ceilf(__fsub_rn(view.fovea.x - kSquare, reach) / kSquare);
  const float last = floorf(__fadd_rn(view.fovea.x, reach) / kSquare);
  const int begin = static_cast<int>(clamped(first, 0.0f, count));
  const int end = static_cast<int>(clamped(last, -1.0f, count - 1.0f)) + 1;
  return {begin, max(end - begin, 0)};
}

}  // namespace stgs::player::cuda
