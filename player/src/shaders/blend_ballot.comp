// SPDX-License-Identifier: Apache-2.0
// Blending, nearest first, where subgroups are known: each draws 8 x 8 pixels by itself, without a
// barrier of the workgroup: a quarter of a tile, or at half resolution a tile of a square. It takes
// the list a splat a lane, keeps those whose ellipse meets its quarter, and goes through these.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "frame.glsl"

// After frame.glsl, on which they build.
#include "fovea.glsl"
#include "stgs/format/math/blend.h"
#include "write_pixel.glsl"

layout(constant_id = 0) const uint kLanes = 32u;  // of a subgroup: 16 or 32
layout(local_size_x_id = 1) in;                   // kQuarters subgroups
layout(std430, set = 1, binding = 1) readonly buffer ListBuffer {
  uint list[];
};
layout(std430, set = 1, binding = 3) readonly buffer PatchBuffer {
  uint patch_list[];
};

const uint kSide = uint(kQuarterPixels);
const uint kMostLanes = 32u, kMostEach = 4u;  // pixels of a lane, below each other
const uint kEach = kSide * kSide / kLanes;
const uint kStep = kSide / kEach;  // rows between them

shared vec4 stage_a[kQuarters * kMostLanes], stage_b[kQuarters * kMostLanes],
    stage_c[kQuarters * kMostLanes];

float transmittance[kMostEach];  // below 0 where the pixel is finished, or outside of the picture
vec4 sums[kMostEach];

void blend_splat(vec2 first, vec4 a, vec4 b, vec4 c) {
  float dx = first.x - a.x;
  float along = fma(a.z * dx, dx, b.y), cross_ = a.w * dx;
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    float dy = first.y + float(k * kStep) - a.y;
    float log2_alpha = min(b.z, fma(dy, fma(b.x, dy, cross_), along));
    // Without branches: most splats that are gone through are drawn at some pixel of the lanes. Of
    // a finished pixel the weight is not above 0, and what it would leave below 0.
    float t = transmittance[k], alpha = log2_alpha >= kLog2Threshold ? exp2(log2_alpha) : 0.0f;
    precise float weight = alpha * t, after = t - weight;  // as blend.comp rounds
    bool drawn = after >= kTransmittanceMin;
    sums[k] = fma(vec4(drawn ? weight : 0.0f), c, sums[k]);
    transmittance[k] = drawn ? after : -abs(t);
  }
}

void bring(uint number, uint halvings, out vec4 a, out vec4 b, out vec4 c) {
  uint splat = number & (1u << kSplatBits) - 1u;
  a = splat_a[splat];
  b = splat_b[splat];
  c = splat_c[splat];
  if (kFovea && halvings == 1u) halve_splat(a, b);
  b.z = min(b.y, kLog2AlphaMax);
}

// The tile that the workgroup draws, or the first of the square; with a fovea, find_patches.comp
// has told. False where there is none for it.
bool find_tile(uint v, uvec2 tiles, out uvec2 tile, out uint halvings) {
  tile = gl_WorkGroupID.xy;
  halvings = 0u;
  if (!kFovea) return true;
  uint number = group_number(), first = frame.view[v].first_tile;
  if (number >= patch_counts[kPatchKinds * v + push.patches]) return false;
  uint last = first + tiles.x * tiles.y - 1u;
  uint code = patch_list[push.patches == kLongPatches ? first + number : last - number];
  halvings = code >> 31u;
  uint at = code & ~kHalvedPatch;
  tile = uvec2(at % tiles.x, at / tiles.x);
  return true;
}

void main() {
  uint quarter = gl_SubgroupID, lane = gl_SubgroupInvocationID, stage = quarter * kMostLanes;
  uint v = push.view, halvings;
  uvec2 tiles = uvec2(frame.view[v].tiles_x, frame.view[v].tiles_y), lister;
  if (!find_tile(v, tiles, lister, halvings)) return;
  // A square at half resolution has for quarters its tiles.
  uvec2 part = uvec2(quarter % 2u, quarter / 2u);
  uvec2 tile = lister + part * halvings;
  if (tile.x >= tiles.x || tile.y >= tiles.y) return;
  // Of the picture of half the size where it is halved.
  uvec2 corner = halvings == 1u ? tile * kSide : tile * uint(kTilePixels) + part * kSide;
  uvec2 whole = uvec2(frame.view[v].width, frame.view[v].height);
  uvec2 size = (whole + halvings) >> halvings;
  if (corner.x >= size.x || corner.y >= size.y) return;
  uvec2 pixel = corner + uvec2(lane % kSide, lane / kSide);
  vec2 centre = vec2(pixel) + 0.5f;
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    bool inside = pixel.x < size.x && pixel.y + k * kStep < size.y;
    transmittance[k] = inside ? 1.0f : -1.0f;
    sums[k] = vec4(0.0f);
  }
  uvec2 range = tile_ranges[frame.view[v].first_tile + lister.y * tiles.x + lister.x];
  range.x = ~range.x;
  uint wanted = 1u << kSplatBits << quarter;
  // A splat is asked for one batch ahead, its number two.
  vec4 a = vec4(0.0f), b = vec4(0.0f), c = vec4(0.0f);
  uint number = range.x + lane < range.y ? list[range.x + lane] : 0u;
  uint next = range.x + kLanes + lane < range.y ? list[range.x + kLanes + lane] : 0u;
  if ((number & wanted) != 0u) bring(number, halvings, a, b, c);
  for (uint at = range.x; at < range.y; at += kLanes) {
    bool unfinished = false;
    [[unroll]] for (uint k = 0u; k < kEach; ++k) unfinished = unfinished || transmittance[k] > 0.0f;
    if (subgroupBallot(unfinished).x == 0u) break;
    bool met = (number & wanted) != 0u;
    uvec4 hits = subgroupBallot(met);
    if (met) {
      uint to = stage + subgroupBallotExclusiveBitCount(hits);
      stage_a[to] = a;
      stage_b[to] = b;
      stage_c[to] = c;
    }
    subgroupBarrier();
    number = next;
    if ((number & wanted) != 0u) bring(number, halvings, a, b, c);
    next = at + 2u * kLanes + lane < range.y ? list[at + 2u * kLanes + lane] : 0u;
    uint count = subgroupBallotBitCount(hits);
    for (uint k = stage; k < stage + count; ++k) {
      blend_splat(centre, stage_a[k], stage_b[k], stage_c[k]);
    }
    subgroupBarrier();
  }
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uvec2 to = uvec2(pixel.x, pixel.y + k * kStep);
    if (to.x >= size.x || to.y >= size.y) continue;
    if (kFovea && halvings == 1u) {
      write_square(2u * to, whole, sums[k], abs(transmittance[k]));
    } else {
      write_pixel(to.x, to.y, sums[k], abs(transmittance[k]));
    }
  }
}
