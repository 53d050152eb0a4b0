// SPDX-License-Identifier: Apache-2.0
// Blends the splats of a view, nearest first: one workgroup per tile, one invocation per pixel; at
// half resolution, only the first 64 invocations have a pixel. The list of the tile is staged in
// shared memory, kGroup splats at a time, until all pixels are finished. Each block of pixels
// processes only the splats of a batch whose ellipse meets it. Blocks are successive invocations,
// so that subgroups of up to 32 skip the same splats.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

// Requires frame.glsl.
#include "footprint.glsl"
#include "fovea.glsl"
#include "write_pixel.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 1) readonly buffer ListBuffer {
  uint list[];
};

shared vec4 stage_a[kGroup], stage_b[kGroup], stage_c[kGroup];
shared uint unfinished[2];  // pixels; two counters used alternately

const uint kBlocks = 8u;             // per tile, in two columns and four rows
const uvec2 kBlock = uvec2(8u, 4u);  // pixels
const uint kWords = kGroup / 32u;
shared uint hits[kBlocks * kWords];  // per block, one bit per staged splat

// Returns the corner of a block in the tile. `halvings` is 1 at half resolution, else 0.
uvec2 block_corner(uint block, uint halvings) {
  return (halvings == 1u ? uvec2(0u, block) : uvec2(block % 2u, block / 2u)) * kBlock;
}

// Records which blocks the staged splat of this invocation meets.
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
  // Within a block, invocations follow a Z-order curve: 4 form a square, 16 form a square of these.
  uvec2 at_block = uvec2(thread & 1u | thread >> 1u & 2u | thread >> 2u & 4u,
                         thread >> 1u & 1u | thread >> 2u & 2u);
  // At half resolution, these are pixels of the image of half the size.
  uvec2 corner = tile * (uint(kTilePixels) >> halvings);
  uvec2 at_pixel = corner + block_corner(block, halvings) + at_block;
  uvec2 full_size = uvec2(frame.view[v].width, frame.view[v].height);
  uvec2 size = (full_size + halvings) >> halvings;
  bool inside = block < kBlocks >> 2u * halvings && at_pixel.x < size.x && at_pixel.y < size.y;
  vec2 centre = vec2(at_pixel) + 0.5f;
  // A square at half resolution has one list, and its tiles take the role of quarters.
  uvec2 lister = halvings == 1u ? tile & ~1u : tile;
  uint quarter_bits = (halvings == 1u ? 1u << (tile.x & 1u) + 2u * (tile.y & 1u) : 0xFu)
                      << kSplatBits;
  uvec2 range = tile_ranges[frame.view[v].first_tile + lister.y * tiles.x + lister.x];
  range.x = ~range.x;
  bool finished = !inside;
  vec4 sums = vec4(0.0f);
  float t = 1.0f;
  if (thread < 2u) unfinished[thread] = 0u;
  uint turn = 0u;
  for (uint at = range.x; at < range.y; at += kGroup) {
    barrier();  // the previous batch has been read
    if (!finished) atomicOr(unfinished[turn], 1u);
    if (thread == 0u) unfinished[turn ^ 1u] = 0u;
    if (thread < kBlocks * kWords) hits[thread] = 0u;
    barrier();
    if (unfinished[turn] == 0u) break;
    turn ^= 1u;
    if (at + thread < range.y) {
      uint entry = list[at + thread], splat = entry & (1u << kSplatBits) - 1u;
      vec4 a = splat_a[splat], b = splat_b[splat];
      if (kFovea && halvings == 1u) halve_splat(a, b);
      stage_a[thread] = a;
      stage_b[thread] = b;
      stage_c[thread] = splat_c[splat];
      if ((entry & quarter_bits) != 0u) find_hits(thread, a, b, vec2(corner), halvings);
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
    write_square(2u * at_pixel, full_size, sums, t);
  } else {
    write_pixel(at_pixel.x, at_pixel.y, sums, t);
  }
}
