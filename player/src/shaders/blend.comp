// SPDX-License-Identifier: Apache-2.0
// Blending of a view, nearest first: a workgroup a tile, a pixel an invocation; at half resolution
// the first 64 have one. The tile's list goes through shared memory kGroup splats at a time until
// no pixel lets light through. Of each batch a block of pixels goes through the splats alone whose
// ellipse meets it; blocks are invocations side by side, so that subgroups of up to 32 agree on
// what they skip.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

// After frame.glsl, on which it builds.
#include "footprint.glsl"
#include "fovea.glsl"
#include "stgs/format/math/blend.h"
#include "write_pixel.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 1) readonly buffer ListBuffer {
  uint list[];
};

shared vec4 stage_a[kGroup], stage_b[kGroup], stage_c[kGroup];
shared uint unfinished[2];  // pixels, in turns

const uint kBlocks = 8u;             // of a tile, two beside and four below each other
const uvec2 kBlock = uvec2(8u, 4u);  // pixels
const uint kWords = kGroup / 32u;
shared uint hits[kBlocks * kWords];  // of a block, a bit a splat of the stage

// Where a block begins in the tile; `halvings` is 1 where it is drawn at half resolution.
uvec2 block_corner(uint block, uint halvings) {
  return (halvings == 1u ? uvec2(0u, block) : uvec2(block % 2u, block / 2u)) * kBlock;
}

// Whether the splats of the stage meet the blocks.
void find_hits(uint thread, vec4 a, vec4 b, vec2 tile, uint halvings) {
  for (uint block = 0u; block < kBlocks >> 2u * halvings; ++block) {
    vec2 low = tile + vec2(block_corner(block, halvings)) + 0.5f;
    vec2 high = low + vec2(kBlock) - 1.0f;
    if (meets(a, b, low, high)) {
      atomicOr(hits[block * kWords + thread / 32u], 1u << (thread % 32u));
    }
  }
}

void main() {
  uint thread = gl_LocalInvocationIndex, block = thread / 32u;
  uint v = push.view;
  uvec2 tiles = uvec2(frame.view[v].tiles_x, frame.view[v].tiles_y), tile = gl_WorkGroupID.xy;
  if (tile.x >= tiles.x || tile.y >= tiles.y) return;
  uint halvings = kFovea && square_is_halved(v, ivec2(tile / 2u)) ? 1u : 0u;
  // Within a block, four invocations are a square and sixteen are four.
  uvec2 at_block = uvec2(thread & 1u | thread >> 1u & 2u | thread >> 2u & 4u,
                         thread >> 1u & 1u | thread >> 2u & 2u);
  // Of the picture of half the size where it is halved, as what follows.
  uvec2 corner = tile * (uint(kTilePixels) >> halvings);
  uvec2 at_pixel = corner + block_corner(block, halvings) + at_block;
  uvec2 whole = uvec2(frame.view[v].width, frame.view[v].height);
  uvec2 size = (whole + halvings) >> halvings;
  bool inside = block < kBlocks >> 2u * halvings && at_pixel.x < size.x && at_pixel.y < size.y;
  vec2 centre = vec2(at_pixel) + 0.5f;
  // A square that is halved has one list, and for quarters its tiles.
  uvec2 lister = halvings == 1u ? tile & ~1u : tile;
  uint wanted = (halvings == 1u ? 1u << (tile.x & 1u) + 2u * (tile.y & 1u) : 0xFu) << kSplatBits;
  uvec2 range = tile_ranges[frame.view[v].first_tile + lister.y * tiles.x + lister.x];
  range.x = ~range.x;
  bool finished = !inside;
  vec4 sums = vec4(0.0f);
  float t = 1.0f;
  if (thread < 2u) unfinished[thread] = 0u;
  uint turn = 0u;
  for (uint at = range.x; at < range.y; at += kGroup) {
    barrier();  // the stage of before has been read
    if (!finished) atomicOr(unfinished[turn], 1u);
    if (thread == 0u) unfinished[turn ^ 1u] = 0u;
    if (thread < kBlocks * kWords) hits[thread] = 0u;
    barrier();
    if (unfinished[turn] == 0u) break;
    turn ^= 1u;
    if (at + thread < range.y) {
      uint number = list[at + thread], splat = number & (1u << kSplatBits) - 1u;
      vec4 a = splat_a[splat], b = splat_b[splat];
      if (kFovea && halvings == 1u) halve_splat(a, b);
      stage_a[thread] = a;
      stage_b[thread] = b;
      stage_c[thread] = splat_c[splat];
      if ((number & wanted) != 0u) find_hits(thread, a, b, vec2(corner), halvings);
    }
    barrier();
    for (uint word = 0u; word < kWords && !finished; ++word) {
      uint bits = hits[block * kWords + word];
      while (bits != 0u) {
        uint k = word * 32u + uint(findLSB(bits));
        bits &= bits - 1u;
        vec4 a = stage_a[k], b = stage_b[k];
        vec2 d = centre - a.xy;
        float log2_alpha = min(b.y, fma(d.y, fma(b.x, d.y, a.w * d.x), fma(a.z * d.x, d.x, b.y)));
        if (log2_alpha < kLog2Threshold) continue;
        precise float weight = exp2(min(log2_alpha, kLog2AlphaMax)) * t, after = t - weight;
        if (after < kTransmittanceMin) {
          finished = true;
          break;
        }
        sums = fma(vec4(weight), stage_c[k], sums);
        t = after;
      }
    }
  }
  if (!inside) return;
  if (kFovea && halvings == 1u) {
    write_square(2u * at_pixel, whole, sums, t);
  } else {
    write_pixel(at_pixel.x, at_pixel.y, sums, t);
  }
}
