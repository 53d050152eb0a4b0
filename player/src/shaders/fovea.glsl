// SPDX-License-Identifier: Apache-2.0
// Regions at half resolution, and splats in them. In such a square of 2 x 2 tiles, the first tile
// holds the list of all four, and the tiles take the role of quarters. Requires frame.glsl.
#include "stgs/format/math/fovea.h"

// Returns whether a square of 2 x 2 tiles is at half resolution, as math::beyond_fovea does.
// Rounding is identical in all shaders.
bool square_is_halved(uint view, ivec2 square) {
  const float side = float(kFoveaSquare);
  Vec2 centre = frame.view[view].fovea;
  float radius = frame.view[view].fovea_radius;
  precise vec2 from = vec2(square) * side - vec2(centre.x, centre.y);
  precise vec2 to = -from - side;
  vec2 off = max(vec2(0.0f), max(from, to));
  precise float squared = off.x * off.x + off.y * off.y, limit = radius * radius;
  return squared > limit;
}

// Returns the squares of a row that are at full resolution: first and count.
ivec2 sharp_squares(uint view, int row) {
  const float side = float(kFoveaSquare);
  Vec2 centre = frame.view[view].fovea;
  float radius = frame.view[view].fovea_radius;
  int count = (frame.view[view].tiles_x + 1) / 2;
  float top = float(row) * side;
  float off = max(0.0f, max(top - centre.y, centre.y - top - side));
  float reach = sqrt(max(radius * radius - off * off, 0.0f));
  int first = int(clamp(ceil((centre.x - side - reach) / side), 0.0f, float(count)));
  int end = int(clamp(floor((centre.x + reach) / side), -1.0f, float(count - 1))) + 1;
  // Correct the rounding of the square root, which is less than a square.
  first = max(first - 1, 0);
  end = min(end + 1, count);
  while (first < end && square_is_halved(view, ivec2(first, row))) ++first;
  while (first < end && square_is_halved(view, ivec2(end - 1, row))) --end;
  return ivec2(first, max(end - first, 0));
}

// A patch is the index of a tile of the view. With this bit, it is the first tile of a square at
// half resolution.
const uint kHalvedPatch = 1u << 31u;

// Converts the first two parts of a splat to the image of half the size.
void halve_splat(inout vec4 a, inout vec4 b) {
  Falloff falloff;
  falloff.xx = a.z;
  falloff.xy = a.w;
  falloff.yy = b.x;
  HalvedSplat halved = halved_splat(conic_of(falloff));
  falloff = falloff_of(halved.conic);
  a = vec4(0.5f * a.xy, falloff.xx, falloff.xy);
  b.x = falloff.yy;
  b.y += log2(halved.scale);
}
