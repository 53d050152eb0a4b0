// SPDX-License-Identifier: Apache-2.0
// Blending, nearest first: a workgroup a tile, a pixel an invocation. The tile's list goes through
// shared memory kGroup splats at a time until no pixel lets light through.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"
#include "stgs/format/math/blend.h"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 1) readonly buffer ListBuffer {
  uint list[];
};

shared vec4 stage_a[kGroup], stage_b[kGroup], stage_c[kGroup];
shared uint unfinished[2];  // pixels, in turns

void write_pixel(uint x, uint y, vec4 sums, float t) {
  uint to = y * uint(view.width) + x;
  float alpha = 1.0f - t;
  red_plane[to] = fma(t, view.background.x, sums.x);
  green_plane[to] = fma(t, view.background.y, sums.y);
  blue_plane[to] = fma(t, view.background.z, sums.z);
  alpha_plane[to] = alpha;
  depth_plane[to] = alpha > 0.0f ? sums.w / alpha : 0.0f;
}

void main() {
  uint thread = gl_LocalInvocationIndex;
  uint x = gl_WorkGroupID.x * uint(kTilePixels) + thread % uint(kTilePixels);
  uint y = gl_WorkGroupID.y * uint(kTilePixels) + thread / uint(kTilePixels);
  bool inside = x < uint(view.width) && y < uint(view.height);
  vec2 centre = vec2(float(x) + 0.5f, float(y) + 0.5f);
  uvec2 range = tile_ranges[gl_WorkGroupID.y * uint(view.tiles_x) + gl_WorkGroupID.x];
  bool finished = !inside;
  vec4 sums = vec4(0.0f);
  float t = 1.0f;
  if (thread < 2u) unfinished[thread] = 0u;
  uint turn = 0u;
  for (uint at = range.x; at < range.y; at += kGroup) {
    barrier();  // the stage of before has been read
    if (!finished) atomicOr(unfinished[turn], 1u);
    if (thread == 0u) unfinished[turn ^ 1u] = 0u;
    if (at + thread < range.y) {
      uint splat = list[at + thread];
      stage_a[thread] = splat_a[splat];
      stage_b[thread] = splat_b[splat];
      stage_c[thread] = splat_c[splat];
    }
    barrier();
    if (unfinished[turn] == 0u) break;
    turn ^= 1u;
    uint count = min(kGroup, range.y - at);
    for (uint k = 0u; k < count && !finished; ++k) {
      vec4 a = stage_a[k], b = stage_b[k];
      vec2 d = centre - a.xy;
      float log2_alpha =
          min(b.y, fma(d.y, fma(b.x, d.y, a.w * d.x), b.y + a.z * d.x * d.x));
      if (log2_alpha < kLog2Threshold) continue;
      float alpha = min(kAlphaMax, exp2(log2_alpha));
      float after = t * (1.0f - alpha);
      if (after < kTransmittanceMin) {
        finished = true;
      } else {
        sums = fma(vec4(alpha * t), stage_c[k], sums);
        t = after;
      }
    }
  }
  if (inside) write_pixel(x, y, sums, t);
}
