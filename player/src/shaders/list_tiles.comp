// SPDX-License-Identifier: Apache-2.0
// Instances: for each splat, nearest first, the tiles that its ellipse meets. Those of one tile are
// in the order of depth then, which the stable sort by tile keeps. The nearest are listed where not
// all fit.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

// After frame.glsl, on which it builds.
#include "footprint.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 1) readonly buffer OrderBuffer {
  uint order[];
};
layout(std430, set = 1, binding = 2) writeonly buffer KeyBuffer {
  uint keys[];
};
layout(std430, set = 1, binding = 3) writeonly buffer ValueBuffer {
  uint values[];
};

// Rows of tiles that an invocation goes through alone; a splat with more is the workgroup's.
const int kAlone = 8;

shared uint large[kGroup];  // ranks
shared uint large_count;

uint place_of(uint rank) {
  return tile_places[rank] + tile_sums[rank / kScanTile];
}

void write_instance(uint to, uint tile, uint splat) {
  if (to >= listed) return;
  keys[to] = tile;
  values[to] = splat;
}

void main() {
  uint thread = gl_LocalInvocationIndex;
  uint rank = group_number() * kGroup + thread;
  if (thread == 0u) large_count = 0u;
  barrier();
  if (rank < visible) {
    uint splat = order[rank];
    Footprint f = footprint_of(splat);
    if (f.rows > kAlone) {
      large[atomicAdd(large_count, 1u)] = rank;
    } else {
      uint to = place_of(rank);
      for (int r = 0; r < f.rows; ++r) {
        ivec2 span = span_of(f, f.row + r);
        uint tile = f.first_tile + uint((f.row + r) * f.tiles_x + span.x);
        for (uint k = 0u; k < uint(span.y); ++k, ++to) write_instance(to, tile + k, splat);
      }
    }
  }
  barrier();
  for (uint one = 0u; one < large_count; ++one) {
    uint splat = order[large[one]], to = place_of(large[one]);
    Footprint f = footprint_of(splat);
    for (int r = 0; r < f.rows; ++r) {
      ivec2 span = span_of(f, f.row + r);
      uint tile = f.first_tile + uint((f.row + r) * f.tiles_x + span.x);
      for (uint k = thread; k < uint(span.y); k += kGroup) {
        write_instance(to + k, tile + k, splat);
      }
      to += uint(span.y);
    }
  }
}
