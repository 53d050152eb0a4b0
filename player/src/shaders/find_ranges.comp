// SPDX-License-Identifier: Apache-2.0
// Finds the range of instances of each tile, unless the last sort pass has written it.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 0) readonly buffer KeyBuffer {
  uint keys[];
};

void main() {
  uint i = group_number() * kGroup + gl_LocalInvocationIndex, n = work[push.work].w;
  if (i >= n) return;
  uint tile = keys[i];
  if (tile >= tile_ranges.length()) return;
  if (i == 0u || keys[i - 1u] != tile) tile_ranges[tile].x = ~i;
  if (i + 1u == n || keys[i + 1u] != tile) tile_ranges[tile].y = i + 1u;
}
