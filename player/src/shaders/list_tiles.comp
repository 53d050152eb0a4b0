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
// Instances of a workgroup that go through shared memory, from where they are written side by side.
const uint kStage = 3072u;

shared uint stage[kStage];  // tile, and the splat's invocation in the lower eight bits
shared uint splats[kGroup];
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

// An instance of the splat of invocation `of`; `first` is the workgroup's first place, `end` the
// next one's: were more tiles found than were counted, they would be left out.
void put(bool staged, uint first, uint end, uint to, uint tile, uint of) {
  if (to >= end) return;
  if (staged) {
    stage[to - first] = tile << 8u | of;
  } else {
    write_instance(to, tile, splats[of]);
  }
}

void main() {
  uint thread = gl_LocalInvocationIndex;
  uint first_rank = group_number() * kGroup, rank = first_rank + thread;
  if (first_rank >= visible) return;
  uint first = place_of(first_rank);
  uint end = first_rank + kGroup < visible ? place_of(first_rank + kGroup) : instances;
  if (first >= listed) return;
  // Sums that stopped at the most that is counted say nothing of what lies between them.
  bool staged = end - first <= kStage && end < kManyInstances;
  if (thread == 0u) large_count = 0u;
  // Were fewer found, the rest would stand in a tile that they do not meet, where they are not
  // drawn.
  for (uint k = thread; staged && k < end - first; k += kGroup) stage[k] = 0u;
  barrier();
  if (rank < visible) {
    uint splat = order[rank];
    splats[thread] = splat;
    Footprint f = footprint_of(splat);
    if (f.rows > kAlone) {
      large[atomicAdd(large_count, 1u)] = rank;
    } else {
      uint to = place_of(rank);
      for (int r = 0; r < f.rows; ++r) {
        ivec2 span = span_of(f, f.row + r);
        uint tile = f.first_tile + uint((f.row + r) * f.tiles_x + span.x);
        for (uint k = 0u; k < uint(span.y); ++k, ++to)
          put(staged, first, end, to, tile + k, thread);
      }
    }
  }
  barrier();
  for (uint one = 0u; one < large_count; ++one) {
    uint owner = large[one] - first_rank, splat = splats[owner], to = place_of(large[one]);
    Footprint f = footprint_of(splat);
    for (int r = 0; r < f.rows; ++r) {
      ivec2 span = span_of(f, f.row + r);
      uint tile = f.first_tile + uint((f.row + r) * f.tiles_x + span.x);
      for (uint k = thread; k < uint(span.y); k += kGroup) {
        put(staged, first, end, to + k, tile + k, owner);
      }
      to += uint(span.y);
    }
  }
  if (!staged) return;
  barrier();
  for (uint k = thread; k < end - first; k += kGroup) {
    write_instance(first + k, stage[k] >> 8u, splats[stage[k] & 0xFFu]);
  }
}
