// SPDX-License-Identifier: Apache-2.0
// For each splat, nearest first, how many tiles its ellipse meets.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

// After frame.glsl, on which it builds.
#include "footprint.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 1) readonly buffer OrderBuffer {
  uint order[];
};

void main() {
  uint rank = group_number() * kGroup + gl_LocalInvocationIndex;
  if (rank >= visible) return;
  uint splat = order[rank];
  Footprint f = footprint_of(splat);
  uint count = 0u;
  for (int r = 0; r < f.rows; ++r) count += uint(span_of(f, f.row + r).y);
  tile_places[rank] = count;
}
