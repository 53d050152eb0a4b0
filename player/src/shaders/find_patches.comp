// SPDX-License-Identifier: Apache-2.0
// Where there are foveae: what of a view is drawn at full resolution, by tiles, and what at half,
// by squares of 2 x 2. Those with long lists come first: begun late, one of thousands would keep
// the frame waiting. An invocation is a square; the workgroups along y are the views.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

// After frame.glsl, on which it builds.
#include "fovea.glsl"
#include "last.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 3) writeonly buffer PatchBuffer {
  uint patch_list[];  // a view's from its first tile on: from there those with long lists, from the
                      // last tile backwards those with short ones
};

const uint kLong = 1024u;  // splats

// How many workgroups draw a view's patches. The last workgroup calls it.
void plan_blend(uint thread) {
  if (thread >= kPatchKinds * frame.views) return;
  work[kWorkPatches + thread] = work_for(atomicAdd(patch_counts[thread], 0u), 1u);
}

shared uint here[kPatchKinds];  // patches of the workgroup
shared uint before[kPatchKinds];

void main() {
  uint thread = gl_LocalInvocationIndex, v = gl_WorkGroupID.y;
  if (thread < kPatchKinds) here[thread] = 0u;
  barrier();
  uvec2 tiles = uvec2(frame.view[v].tiles_x, frame.view[v].tiles_y), squares = (tiles + 1u) / 2u;
  uint number = gl_WorkGroupID.x * kGroup + thread;
  uvec2 square = uvec2(number % squares.x, number / squares.x);
  bool inside = square.y < squares.y, halved = inside && square_is_halved(v, ivec2(square));
  uint codes[4], places[4];  // of places the highest bit: not a long list
  uint count = 0u;
  for (uint k = 0u; k < 4u; ++k) {
    uvec2 tile = 2u * square + uvec2(k % 2u, k / 2u);
    if (!inside || tile.x >= tiles.x || tile.y >= tiles.y || (halved && k > 0u)) continue;
    uint at = tile.y * tiles.x + tile.x;
    uvec2 range = tile_ranges[frame.view[v].first_tile + at];
    uint kind = range.y - ~range.x > kLong ? kLongPatches : kShortPatches;  // also where none is
    codes[count] = at | (halved ? kHalvedPatch : 0u);
    places[count] = atomicAdd(here[kind], 1u) | kind << 31u;
    ++count;
  }
  barrier();
  if (thread == 0u) {  // as is_last has it
    for (uint kind = 0u; kind < kPatchKinds; ++kind) {
      before[kind] = atomicAdd(patch_counts[kPatchKinds * v + kind], here[kind]);
    }
  }
  barrier();
  uint first = frame.view[v].first_tile, last = first + tiles.x * tiles.y - 1u;
  for (uint k = 0u; k < count; ++k) {
    uint kind = places[k] >> 31u, place = before[kind] + (places[k] & 0x7FFFFFFFu);
    patch_list[kind == kLongPatches ? first + place : last - place] = codes[k];
  }
  uint groups = gl_NumWorkGroups.x * gl_NumWorkGroups.y;
  if (is_last(kEndedFindPatches, groups, thread)) plan_blend(thread);
}
