// SPDX-License-Identifier: Apache-2.0
// Slices the primitives at a time: one invocation per primitive, cheapest tests first, as
// make_splat() in raster/slice.cpp. View-independent work is done once. In each view, the splats of
// a chunk are stored contiguously from the beginning of the chunk, in id order.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/sh.h"

layout(local_size_x = 256) in;
layout(constant_id = 0) const int kDegree = 3;
layout(constant_id = 1) const
    bool kSeveral = true;  // several views; a single view has its own variant

// The same block of memory with two element types.
layout(std430, set = 1, binding = 0) readonly buffer FourBuffer {
  vec4 fours[];
};
layout(std430, set = 1, binding = 1) readonly buffer PairBuffer {
  uvec2 pairs[];
};

// A ScreenSplat as it is stored.
struct SplatVectors {
  vec4 a, b, c;
};

// The data of a segment: arrays of n entries, a multiple of kGroup (packed_segment.h).
struct Arrays {
  uint pair;  // offset of the first array, in pairs
  uint n;
};

vec2 pair_at(uint i) {
  return uintBitsToFloat(pairs[i]);
}

// Returns t - T, compensated for the rounding of t and of the difference.
float since(Part part, float time) {
  precise float difference = part.ticks - time;
  precise float back = difference - part.ticks;
  precise float rounding = (part.ticks - (difference - back)) - (time + back);
  precise float dt = difference + (rounding + part.ticks_rest);
  return dt;
}

// Returns false if the distance or a sum of the SH coefficients is not finite (representation 4.6).
bool colour_of(Arrays at, uint i, Vec3 from_camera, out Vec3 colour) {
  float square = dot3(from_camera, from_camera);
  float n = 1.0f / sqrt(square);
  ShBasis basis = sh_basis(vec3_of(from_camera.x * n, from_camera.y * n, from_camera.z * n));
  const int floats = 3 * (kDegree + 1) * (kDegree + 1);
  float sums[3] = float[3](0.0f, 0.0f, 0.0f);
  [[unroll]] for (int p = 0; 4 * p < floats; ++p) {
    uvec2 bits = pairs[at.pair + (9u + uint(p)) * at.n + i];
    vec4 four = vec4(unpackHalf2x16(bits.x), unpackHalf2x16(bits.y));
    [[unroll]] for (int k = 0; k < 4; ++k) {
      int number = 4 * p + k;
      if (number < floats) sums[number % 3] += basis.v[number / 3] * four[k];
    }
  }
  colour = vec3_of(sh_colour(sums[0]), sh_colour(sums[1]), sh_colour(sums[2]));
  return is_finite(square) && is_finite(sums[0]) && is_finite(sums[1]) && is_finite(sums[2]);
}

// A primitive at the rendered time.
struct Moved {
  Vec3 position;
  float opacity;
};

// Returns false if the primitive is invisible from everywhere.
bool move(Part part, Arrays at, uint i, out Moved one) {
  vec4 position_time = fours[(at.pair + at.n) / 2u + i];
  vec4 velocity_opacity = fours[(at.pair + 3u * at.n) / 2u + i];
  vec2 lifespan = pair_at(at.pair + 5u * at.n + i);
  float dt = since(part, position_time.w);
  one.position =
      position_at(vec3_of(position_time.x, position_time.y, position_time.z),
                  vec3_of(velocity_opacity.x, velocity_opacity.y, velocity_opacity.z), dt);
  one.opacity = velocity_opacity.w * visibility(dt, lifespan.x, lifespan.y);
  return one.opacity >= kAlphaThreshold;
}

// Computes the splat of primitive i in a view. Returns false if it is not visible.
bool make_splat(uint v, Moved one, Arrays at, uint i, out SplatVectors splat) {
  PinholeCamera camera = frame.view[v].camera;
  Vec3 position = one.position;
  if (!(to_camera(camera, position).z >= camera.near_plane)) return false;
  vec4 c = fours[(at.pair + 6u * at.n) / 2u + i];
  vec2 rest = pair_at(at.pair + 8u * at.n + i);
  Sym3 covariance;
  covariance.xx = c.x;
  covariance.xy = c.y;
  covariance.xz = c.z;
  covariance.yy = c.w;
  covariance.yz = rest.x;
  covariance.zz = rest.y;
  Projection p = project_gaussian(camera, position, covariance, screen_blur(frame.view[v].kernel));
  float opacity = splat_opacity(frame.view[v].kernel, one.opacity, p);
  SplatBox box = splat_box(camera, p, opacity);
  if (box.visible == 0) return false;
  Vec3 centre = frame.view[v].centre, colour;
  Vec3 from_camera = vec3_of(position.x - centre.x, position.y - centre.y, position.z - centre.z);
  if (!colour_of(at, i, from_camera, colour)) return false;
  ScreenSplat s = screen_splat(p, box.extent, opacity, colour);
  splat.a = vec4(s.mean.x, s.mean.y, s.falloff.xx, s.falloff.xy);
  splat.b = vec4(s.falloff.yy, s.peak, s.extent.x, s.extent.y);
  splat.c = vec4(s.colour.x, s.colour.y, s.colour.z, s.depth);
  return true;
}

// Returns the part that contains the group: the last one that begins at or before it.
uint part_of(uint group) {
  uint low = push.first_part, high = push.first_part + push.part_count;
  while (high - low > 1u) {
    uint middle = (low + high) / 2u;
    if (parts[middle].first_group <= group) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

const uint kWords = kGroup / 32u;
shared uint visible_bits[kMaxFrameViews * kWords];  // per view, one bit per invocation
shared uint active_in_group;

// Stores the splats of a chunk in a view contiguously. All invocations must call it.
void store(uint v, uint chunk, uint thread, bool is_visible, SplatVectors splat) {
  if (is_visible) atomicOr(visible_bits[v * kWords + thread / 32u], 1u << (thread % 32u));
  barrier();
  uint before = 0u, total = 0u;
  for (uint k = 0u; k < kWords; ++k) {
    uint bits = visible_bits[v * kWords + k];
    total += uint(bitCount(bits));
    if (k == thread / 32u) bits &= (1u << (thread % 32u)) - 1u;
    if (k <= thread / 32u) before += uint(bitCount(bits));
  }
  uint view_chunk = v * frame.chunks + chunk;
  if (is_visible) {
    uint to = view_chunk * kGroup + before;
    splat_a[to] = splat.a;
    splat_b[to] = splat.b;
    splat_c[to] = splat.c;
  }
  if (thread == 0u) chunk_offsets[view_chunk] = total;
}

void main() {
  uint group = group_number(), thread = gl_LocalInvocationIndex;
  if (group >= push.groups) return;
  if (thread < kMaxFrameViews * kWords) visible_bits[thread] = 0u;
  if (thread == 0u) active_in_group = 0u;
  barrier();
  Part part = parts[part_of(group)];
  uint chunk_of_part = group - part.first_group, chunk = part.first_chunk + chunk_of_part;
  uint i = chunk_of_part * kGroup + thread;
  Arrays at;
  at.pair = 2u * part.at;
  at.n = (part.primitives + kGroup - 1u) / kGroup * kGroup;
  vec2 support = pair_at(at.pair + i);
  bool is_active = support.x <= part.ticks && part.ticks <= support.y;
  if (is_active) atomicAdd(active_in_group, 1u);
  Moved one;
  bool is_candidate = is_active && move(part, at, i, one);
  uint views = kSeveral ? frame.views : 1u;
  for (uint v = 0u; v < views; ++v) {
    SplatVectors splat;
    bool is_visible = is_candidate && make_splat(v, one, at, i, splat);
    store(v, chunk, thread, is_visible, splat);
  }
  if (thread == 0u && active_in_group != 0u) atomicAdd(active_count, active_in_group);
}
