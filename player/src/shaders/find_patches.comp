// SPDX-License-Identifier: Apache-2.0
// With foveae: lists the patches of a view, which are tiles at full resolution and squares of 2 x 2
// tiles at half resolution. Patches with long lists come first, since one that starts late prolongs
// the frame. One invocation per square; workgroups along y are views.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

// Requires frame.glsl.
#include "fovea.glsl"
#include "last.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 3) writeonly buffer PatchBuffer {
  // Per view, from its first tile on: patches with long lists; from its last tile backwards:
  // patches with short lists.
  uint patch_list[];
};

const uint kLong = 1024u;  // splats

// Computes the extents of the blend dispatches. Called by the last workgroup.
void plan_blend(uint thread) {
  if (thread >= kPatchKinds * frame.views) return;
  work[kWorkPatches + thread] = work_for(atomicAdd(patch_counts[thread], 0u), 1u);
}

shared uint counts[kPatchKinds];  // patches of the workgroup
shared uint before[kPatchKinds];

void main() {
  uint thread = gl_LocalInvocationIndex, v = gl_WorkGroupID.y;
  if (thread < kPatchKinds) counts[thread] = 0u;
  barrier();
  uvec2 tiles = uvec2(frame.view[v].tiles_x, frame.view[v].tiles_y), squares = (tiles + 1u) / 2u;
  uint number = gl_WorkGroupID.x * kGroup + thread;
  uvec2 square = uvec2(number % squares.x, number / squares.x);
  bool inside = square.y < squares.y, halved = inside && square_is_halved(v, ivec2(square));
  uint codes[4], offsets[4];  // highest bit of offsets: the list is short
  uint count = 0u;
  for (uint k = 0u; k < 4u; ++k) {
    uvec2 tile = 2u * square + uvec2(k % 2u, k / 2u);
    if (!inside || tile.x >= tiles.x || tile.y >= tiles.y || (halved && k > 0u)) continue;
    uint at = tile.y * tiles.x + tile.x;
    uvec2 range = tile_ranges[frame.view[v].first_tile + at];
    uint kind = range.y - ~range.x > kLong ? kLongPatches : kShortPatches;  // also for empty lists
    codes[count] = at | (halved ? kHalvedPatch : 0u);
    offsets[count] = atomicAdd(counts[kind], 1u) | kind << 31u;
    ++count;
  }
  barrier();
  if (thread == 0u) {  // is_last() requires that invocation 0 adds
    for (uint kind = 0u; kind < kPatchKinds; ++kind) {
      before[kind] = atomicAdd(patch_counts[kPatchKinds * v + kind], counts[kind]);
    }
  }
  barrier();
  uint first = frame.view[v].first_tile, last = first + tiles.x * tiles.y - 1u;
  for (uint k = 0u; k < count; ++k) {
    uint kind = offsets[k] >> 31u, index = before[kind] + (offsets[k] & 0x7FFFFFFFu);
    patch_list[kind == kLongPatches ? first + index : last - index] = codes[k];
  }
  uint groups = gl_NumWorkGroups.x * gl_NumWorkGroups.y;
  if (is_last(kEndedFindPatches, groups, thread)) plan_blend(thread);
}
