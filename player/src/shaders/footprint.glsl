// SPDX-License-Identifier: Apache-2.0
// Tests which tiles and pixels the ellipse of a splat meets. All tests are conservative: a false
// hit costs time, a missed hit is an error.

#include "stgs/format/math/fovea.h"

// The ellipse parameterised by row. With v the offset from the centre in half heights, its points
// at v are x + slope v +- width sqrt(1 - v^2). The rightmost point is at v = top, the leftmost at
// -top.
struct Footprint {
  float x, y, per_height, slope, width, top, slack;
  int row, rows;  // of tiles; with foveae, of squares of 2 x 2 tiles
  uint view;
  int pixels_x, tiles_x;  // of its view, as are the following
  uint first_tile;
  float last_pixel;  // centre of the lowest row
};

Footprint footprint_of(uint splat) {
  const int row_pixels = kFovea ? kFoveaSquare : kTilePixels;
  float side = float(row_pixels);
  vec4 a = splat_a[splat], b = splat_b[splat];
  uint v = splat / (frame.chunks * kGroup);
  vec2 extent = b.zw;
  // Must be bit-identical in all shaders: tiles are counted first and listed later.
  precise Footprint f;
  f.x = a.x;
  f.y = a.y;
  f.per_height = 1.0f / max(extent.y, 1e-4f);
  // The blend's rounding error grows with the elongation, falloff.xx extent.x^2 over the limit.
  precise float limit =
      max(b.y - kLog2Threshold, 0.0f) + kLimitSlack - 4e-6f * a.z * extent.x * extent.x;
  f.width = sqrt(limit / -a.z);
  f.slope = -0.5f * a.w / a.z * max(extent.y, 1e-4f);
  precise float ratio = f.slope / f.width;
  f.top = ratio * inversesqrt(1.0f + ratio * ratio);
  if (!(abs(f.top) <= 1.0f)) f.top = ratio < 0.0f ? -1.0f : 1.0f;  // the square overflowed
  precise float slack = 1e-3f + 2e-6f * (extent.y + abs(f.y));
  f.slack = slack + 2e-6f * (abs(f.slope) + f.width + abs(f.x));
  f.view = v;
  f.pixels_x = frame.view[v].width;
  f.tiles_x = frame.view[v].tiles_x;
  f.first_tile = frame.view[v].first_tile;
  f.last_pixel = float(frame.view[v].height) - 0.5f;
  float count = float((frame.view[v].height + row_pixels - 1) / row_pixels);
  precise float first = ceil((f.y - extent.y - slack - (side - 0.5f)) / side);
  precise float last = floor((f.y + extent.y + slack - 0.5f) / side);
  f.row = int(clamp(first, 0.0f, count));
  f.rows = max(int(clamp(last, -1.0f, count - 1.0f)) - f.row + 1, 0);
  return f;
}

// Returns the cells of `pixels` x `pixels` that the ellipse meets in a row of them: first and
// count.
ivec2 span_of(Footprint f, int row, int pixels) {
  float side = float(pixels);
  float top = float(row) * side + 0.5f;
  float bottom = min(top + (side - 1.0f), f.last_pixel);
  precise float above = (top - f.y) * f.per_height, below = (bottom - f.y) * f.per_height;
  precise float beyond = 1.0f + f.slack * f.per_height;
  if (bottom < top || above > beyond || below < -beyond) return ivec2(0);
  float low = clamp(above, -1.0f, 1.0f), high = clamp(below, -1.0f, 1.0f);
  float at_right = clamp(f.top, low, high), at_left = clamp(-f.top, low, high);
  // 1e-6 covers the rounding of v, which matters most near the ends.
  precise float right = f.x + f.slope * at_right +
                        f.width * sqrt(max(1.0f - at_right * at_right, 0.0f) + 1e-6f) + f.slack;
  precise float left = f.x + f.slope * at_left -
                       f.width * sqrt(max(1.0f - at_left * at_left, 0.0f) + 1e-6f) - f.slack;
  float count = float((f.pixels_x + pixels - 1) / pixels);
  int first = int(clamp(ceil((left - (side - 0.5f)) / side), 0.0f, count));
  int last = int(clamp(floor((right - 0.5f) / side), -1.0f, count - 1.0f));
  return ivec2(first, max(last - first + 1, 0));
}

// Returns the minimum of -log2 of the falloff on the segment with one offset fixed and the other in
// [low, high], minus the rounding error of the blend (raster/bin.cpp).
float edge_minimum(float across, float cross_, float along, float fixed_offset, float low,
                   float high) {
  float free = clamp(-0.5f * cross_ * fixed_offset / along, low, high);
  float a = across * fixed_offset * fixed_offset, b = along * free * free,
        c = cross_ * fixed_offset * free;
  return a + b + c - 1e-6f * (a + b + abs(c));
}

// Returns whether any point of the rectangle [low, high] of pixel centres lies in the ellipse.
bool meets(vec4 a, vec4 b, vec2 low, vec2 high) {
  low -= a.xy;
  high -= a.xy;
  bool in_x = low.x <= 0.0f && high.x >= 0.0f, in_y = low.y <= 0.0f && high.y >= 0.0f;
  if (in_x && in_y) return true;
  float limit = b.y - kLog2Threshold + kLimitSlack;
  float xx = -a.z, xy = -a.w, yy = -b.x;
  // The minimum of a convex form lies on an edge that faces its centre.
  if (!in_x && edge_minimum(xx, xy, yy, low.x > 0.0f ? low.x : high.x, low.y, high.y) <= limit) {
    return true;
  }
  return !in_y && edge_minimum(yy, xy, xx, low.y > 0.0f ? low.y : high.y, low.x, high.x) <= limit;
}
