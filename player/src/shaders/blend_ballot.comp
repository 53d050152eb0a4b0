// SPDX-License-Identifier: Apache-2.0
// Blends the splats of a view, nearest first, with known subgroup sizes: each subgroup renders 8 x
// 8 pixels independently, without workgroup barriers: a quarter of a tile, or at half resolution a
// tile of a square. It reads the list one splat per lane, stages those whose ellipse meets its
// quarter, and blends them.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "frame.glsl"

// Require frame.glsl.
#include "fovea.glsl"
#include "write_pixel.glsl"

layout(constant_id = 0) const uint kLanes = 32u;  // per subgroup: 16 or 32
layout(local_size_x_id = 1) in;                   // kQuarters subgroups
layout(std430, set = 1, binding = 1) readonly buffer ListBuffer {
  uint list[];
};
layout(std430, set = 1, binding = 3) readonly buffer PatchBuffer {
  uint patch_list[];
};

const uint kSide = uint(kQuarterPixels);
const uint kMaxLanes = 32u, kMaxEach = 4u;  // pixels per lane, in a column
const uint kEach = kSide * kSide / kLanes;
const uint kStep = kSide / kEach;  // rows between them

shared vec4 stage_a[kQuarters * kMaxLanes], stage_b[kQuarters * kMaxLanes],
    stage_c[kQuarters * kMaxLanes];

float transmittance[kMaxEach];  // negative: the pixel is finished or outside of the image
vec4 sums[kMaxEach];

void blend_splat(vec2 first, vec4 a, vec4 b, vec4 c) {
  float dx = first.x - a.x;
  float along = fma(a.z * dx, dx, b.y), cross_ = a.w * dx;
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    float dy = first.y + float(k * kStep) - a.y;
    float log2_alpha = min(b.z, fma(dy, fma(b.x, dy, cross_), along));
    // Branch-free, since most staged splats contribute to some pixel of the lanes. For finished
    // pixels, the weight is not positive and `after` is negative.
    float t = transmittance[k], alpha = log2_alpha >= kLog2Threshold ? exp2(log2_alpha) : 0.0f;
    precise float weight = alpha * t, after = t - weight;  // as blend.comp rounds
    bool contributes = after >= kTransmittanceMin;
    sums[k] = fma(vec4(contributes ? weight : 0.0f), c, sums[k]);
    transmittance[k] = contributes ? after : -abs(t);
  }
}

void load_splat(uint number, uint halvings, out vec4 a, out vec4 b, out vec4 c) {
  uint splat = number & (1u << kSplatBits) - 1u;
  a = splat_a[splat];
  b = splat_b[splat];
  c = splat_c[splat];
  if (kFovea && halvings == 1u) halve_splat(a, b);
  b.z = min(b.y, kLog2AlphaMax);
}

// Finds the tile of the workgroup, or the first tile of its square; with a fovea, find_patches.comp
// has computed it. Returns false if the workgroup has none.
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
  uint quarter = gl_SubgroupID, lane = gl_SubgroupInvocationID, stage = quarter * kMaxLanes;
  uint v = push.view, halvings;
  uvec2 tiles = uvec2(frame.view[v].tiles_x, frame.view[v].tiles_y), lister;
  if (!find_tile(v, tiles, lister, halvings)) return;
  // In a square at half resolution, the tiles take the role of quarters.
  uvec2 part = uvec2(quarter % 2u, quarter / 2u);
  uvec2 tile = lister + part * halvings;
  if (tile.x >= tiles.x || tile.y >= tiles.y) return;
  // At half resolution, these are pixels of the image of half the size.
  uvec2 corner = halvings == 1u ? tile * kSide : tile * uint(kTilePixels) + part * kSide;
  uvec2 full_size = uvec2(frame.view[v].width, frame.view[v].height);
  uvec2 size = (full_size + halvings) >> halvings;
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
  uint quarter_bit = 1u << kSplatBits << quarter;
  // Splats are loaded one batch ahead, list entries two.
  vec4 a = vec4(0.0f), b = vec4(0.0f), c = vec4(0.0f);
  uint number = range.x + lane < range.y ? list[range.x + lane] : 0u;
  uint next = range.x + kLanes + lane < range.y ? list[range.x + kLanes + lane] : 0u;
  if ((number & quarter_bit) != 0u) load_splat(number, halvings, a, b, c);
  for (uint at = range.x; at < range.y; at += kLanes) {
    bool unfinished = false;
    [[unroll]] for (uint k = 0u; k < kEach; ++k) unfinished = unfinished || transmittance[k] > 0.0f;
    if (subgroupBallot(unfinished).x == 0u) break;
    bool met = (number & quarter_bit) != 0u;
    uvec4 hits = subgroupBallot(met);
    if (met) {
      uint to = stage + subgroupBallotExclusiveBitCount(hits);
      stage_a[to] = a;
      stage_b[to] = b;
      stage_c[to] = c;
    }
    subgroupBarrier();
    number = next;
    if ((number & quarter_bit) != 0u) load_splat(number, halvings, a, b, c);
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
      write_square(2u * to, full_size, sums[k], abs(transmittance[k]));
    } else {
      write_pixel(to.x, to.y, sums[k], abs(transmittance[k]));
    }
  }
}
