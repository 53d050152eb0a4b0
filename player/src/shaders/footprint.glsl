// SPDX-License-Identifier: Apache-2.0
// Which tiles and pixels a splat's ellipse meets. All of it may only err towards meeting: what is
// listed where it is not seen costs time, what is missing is wrong.

#include "stgs/format/math/fovea.h"

// Added to the limit of half squared distances, as raster_bin.cpp adds 1e-4 to their double.
const float kLimitSlack = 0.75e-4f;

// The ellipse as rows see it. With v the offset from the centre in half heights, its points at v
// are x + slope v +- width sqrt(1 - v^2): the farthest right is at v = top, left at -top.
struct Footprint {
  float x, y, per_height, slope, width, top, slack;
  int row, rows;  // of tiles, or of squares of 2 x 2 where there are foveae
  uint view;
  int pixels_x, tiles_x;  // of its view, as what follows
  uint first_tile;
  float last_pixel;  // the centre of the lowest row
};

Footprint footprint_of(uint splat) {
  const int row_pixels = kFovea ? kFoveaSquare : kTilePixels;
  float side = float(row_pixels);
  vec4 a = splat_a[splat], b = splat_b[splat];
  uint v = splat / (frame.chunks * kGroup);
  vec2 extent = b.zw;
  // The same bits wherever it is asked: tiles are counted first and listed later.
  precise Footprint f;
  f.x = a.x;
  f.y = a.y;
  f.per_height = 1.0f / max(extent.y, 1e-4f);
  // The blend's rounding error grows with the elongation, half_xx extent_x^2 over the limit.
  precise float limit =
      max(b.y - kLog2Threshold, 0.0f) + kLimitSlack - 4e-6f * a.z * extent.x * extent.x;
  f.width = sqrt(limit / -a.z);
  f.slope = -0.5f * a.w / a.z * max(extent.y, 1e-4f);
  precise float ratio = f.slope / f.width;
  f.top = ratio * inversesqrt(1.0f + ratio * ratio);
  if (!(abs(f.top) <= 1.0f)) f.top = ratio < 0.0f ? -1.0f : 1.0f;  // a square that overflowed
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

// The squares of so many pixels that are met in a row of them: the first, and how many.
ivec2 span_of(Footprint f, int row, int pixels) {
  float side = float(pixels);
  float top = float(row) * side + 0.5f;
  float bottom = min(top + (side - 1.0f), f.last_pixel);
  precise float above = (top - f.y) * f.per_height, below = (bottom - f.y) * f.per_height;
  precise float beyond = 1.0f + f.slack * f.per_height;
  if (bottom < top || above > beyond || below < -beyond) return ivec2(0);
  float low = clamp(above, -1.0f, 1.0f), high = clamp(below, -1.0f, 1.0f);
  float at_right = clamp(f.top, low, high), at_left = clamp(-f.top, low, high);
  // 1e-6 for the rounding of v, which counts most near the ends.
  precise float right = f.x + f.slope * at_right +
                        f.width * sqrt(max(1.0f - at_right * at_right, 0.0f) + 1e-6f) + f.slack;
  precise float left = f.x + f.slope * at_left -
                       f.width * sqrt(max(1.0f - at_left * at_left, 0.0f) + 1e-6f) - f.slack;
  float count = float((f.pixels_x + pixels - 1) / pixels);
  int first = int(clamp(ceil((left - (side - 0.5f)) / side), 0.0f, count));
  int last = int(clamp(floor((right - 0.5f) / side), -1.0f, count - 1.0f));
  return ivec2(first, max(last - first + 1, 0));
}

// Least -log2 of falloff on the segment where one offset is `still` and the other in [low, high],
// less the rounding error that the blend may make there (raster_bin.cpp).
float edge_minimum(float across, float cross_, float along, float still, float low, float high) {
  float free = clamp(-0.5f * cross_ * still / along, low, high);
  float a = across * still * still, b = along * free * free, c = cross_ * still * free;
  return a + b + c - 1e-6f * (a + b + abs(c));
}

// Whether any point of the rectangle [low, high] of pixel centres lies in the ellipse.
bool meets(vec4 a, vec4 b, vec2 low, vec2 high) {
  low -= a.xy;
  high -= a.xy;
  bool in_x = low.x <= 0.0f && high.x >= 0.0f, in_y = low.y <= 0.0f && high.y >= 0.0f;
  if (in_x && in_y) return true;
  float limit = b.y - kLog2Threshold + kLimitSlack;
  float xx = -a.z, xy = -a.w, yy = -b.x;
  // A convex form is least on an edge that faces its centre.
  if (!in_x && edge_minimum(xx, xy, yy, low.x > 0.0f ? low.x : high.x, low.y, high.y) <= limit) {
    return true;
  }
  return !in_y && edge_minimum(yy, xy, xx, low.y > 0.0f ? low.y : high.y, low.x, high.x) <= limit;
}
