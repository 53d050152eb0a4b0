// SPDX-License-Identifier: Apache-2.0
// Computes the splats of a part of the depth order, as project.comp of the native renderer does.
// Each fragment writes the record of one entry.
#include "record.glsl"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "stgs/format/math/screen_splat.h"
#include "stgs/format/math/sh.h"

// The packed segments: pairs of 32-bit words, kRowPairs to a row, kLayerRows rows to a layer.
uniform usampler2DArray atlas;
// Per segment of the order, two texels: (first row, n, degree, first entry in the order), then
// (primitives, bits of the time, bits of its rounding error, 0). 0 primitives: not shown now.
uniform usampler2D segments;
// Per group of 256 entries of the order: its segment, as an index into `segments`.
uniform usampler2D groups;
// The order, kRecordRow entries to a row: indices of primitives among the entries of all its
// segments.
uniform usampler2D order;
uniform uint first_row;  // of the part in `order`
uniform uint count;      // entries of the part
uniform vec4 view[6];
#include "../splat_view.h"
uniform bool is_linear;  // whether colours are converted from sRGB

layout(location = 0) out uvec4 record_a;
layout(location = 1) out uvec4 record_b;

const uint kRowBits = 12u, kLayerBits = 8u;  // log2 of kRowPairs and kLayerRows
const uint kTableBits = 10u;                 // log2 of the width of `segments` and `groups`

// The data of a segment: arrays of n entries, a multiple of 256 (packed_segment.h).
struct Arrays {
  uint row;  // of the atlas
  uint n;
  int degree;
};

uvec2 pair_bits(Arrays at, uint pair) {
  uint row = at.row + (pair >> kRowBits), column = pair & ((1u << kRowBits) - 1u);
  uvec3 texel = uvec3(column, row & ((1u << kLayerBits) - 1u), row >> kLayerBits);
  return texelFetch(atlas, ivec3(texel), 0).xy;
}

vec2 pair_at(Arrays at, uint pair) {
  return uintBitsToFloat(pair_bits(at, pair));
}

// Reads element i of an array of four floats that begins at `pair`.
vec4 four_at(Arrays at, uint pair, uint i) {
  return vec4(pair_at(at, pair + 2u * i), pair_at(at, pair + 2u * i + 1u));
}

uvec4 table_at(usampler2D table, uint index) {
  return texelFetch(table, ivec2(index & ((1u << kTableBits) - 1u), index >> kTableBits), 0);
}

// Four SH numbers of primitive i.
vec4 sh_plane(Arrays at, uint i, uint plane) {
  uvec2 bits = pair_bits(at, (9u + plane) * at.n + i);
  return vec4(unpackHalf2x16(bits.x), unpackHalf2x16(bits.y));
}

// Sum over four coefficients of three channels, which are stored in three planes.
vec3 sh_block(Arrays at, uint i, uint block, vec4 basis) {
  vec4 a = sh_plane(at, i, 3u * block), b = sh_plane(at, i, 3u * block + 1u);
  vec4 c = sh_plane(at, i, 3u * block + 2u);
  return basis.x * a.xyz + basis.y * vec3(a.w, b.xy) + basis.z * vec3(b.zw, c.x) + basis.w * c.yzw;
}

// Returns false if the distance or a sum of the SH coefficients is not finite (representation 4.6).
bool colour_of(Arrays at, uint i, Vec3 from_camera, out Vec3 colour) {
  float square = dot3(from_camera, from_camera);
  float n = 1.0f / sqrt(square);
  ShBasis b = sh_basis(vec3_of(from_camera.x * n, from_camera.y * n, from_camera.z * n));
  vec3 sums;
  if (at.degree == 0) {
    sums = b.v[0] * sh_plane(at, i, 0u).xyz;
  } else {
    sums = sh_block(at, i, 0u, vec4(b.v[0], b.v[1], b.v[2], b.v[3]));
    if (at.degree >= 2) sums += sh_block(at, i, 1u, vec4(b.v[4], b.v[5], b.v[6], b.v[7]));
    if (at.degree == 2) sums += b.v[8] * sh_plane(at, i, 6u).xyz;
    if (at.degree >= 3) {
      sums += sh_block(at, i, 2u, vec4(b.v[8], b.v[9], b.v[10], b.v[11]));
      sums += sh_block(at, i, 3u, vec4(b.v[12], b.v[13], b.v[14], b.v[15]));
    }
  }
  colour = vec3_of(sh_colour(sums.x), sh_colour(sums.y), sh_colour(sums.z));
  return is_finite(square) && is_finite(sums.x) && is_finite(sums.y) && is_finite(sums.z);
}

Sym3 covariance_at(Arrays at, uint i) {
  vec4 c = four_at(at, 6u * at.n, i);
  vec2 rest = pair_at(at, 8u * at.n + i);
  Sym3 covariance;
  covariance.xx = c.x;
  covariance.xy = c.y;
  covariance.xz = c.z;
  covariance.yy = c.w;
  covariance.yz = rest.x;
  covariance.zz = rest.y;
  return covariance;
}

// Computes the splat of primitive i at a time. Returns false if it is not visible.
bool make_splat(Arrays at, uint i, float ticks, float ticks_rest, out ScreenSplat splat) {
  vec2 support = pair_at(at, i);
  if (!(support.x <= ticks && ticks <= support.y)) return false;
  vec4 position_time = four_at(at, at.n, i), velocity_opacity = four_at(at, 3u * at.n, i);
  vec2 lifespan = pair_at(at, 5u * at.n + i);
  float dt = since(ticks, ticks_rest, position_time.w);
  float opacity = velocity_opacity.w * visibility(dt, lifespan.x, lifespan.y);
  if (!(opacity >= kAlphaThreshold)) return false;
  Vec3 position =
      position_at(vec3_of(position_time.x, position_time.y, position_time.z),
                  vec3_of(velocity_opacity.x, velocity_opacity.y, velocity_opacity.z), dt);
  PinholeCamera camera = camera_of_view();
  if (!(to_camera(camera, position).z >= camera.near_plane)) return false;
  int kernel = kernel_of_view();
  Projection p = project_gaussian(camera, position, covariance_at(at, i), screen_blur(kernel));
  opacity = splat_opacity(kernel, opacity, p);
  SplatBox box = splat_box(camera, p, opacity);
  if (box.visible == 0) return false;
  Vec3 from_camera =
      vec3_of(position.x - view[5].x, position.y - view[5].y, position.z - view[5].z);
  Vec3 colour;
  if (!colour_of(at, i, from_camera, colour)) return false;
  splat = screen_splat(p, box.extent, opacity, colour);
  return true;
}

vec3 linear_of(vec3 colour) {
  vec3 power = pow((colour + 0.055) / 1.055, vec3(2.4));
  return mix(power, colour / 12.92, vec3(lessThanEqual(colour, vec3(0.04045))));
}

// Returns false if the primitive of an entry is not visible.
bool splat_of(uint entry, out ScreenSplat splat) {
  uint segment = table_at(groups, entry >> 8u).x;
  uvec4 a = table_at(segments, 2u * segment), b = table_at(segments, 2u * segment + 1u);
  uint i = entry - a.w;
  if (i >= b.x) return false;
  Arrays at;
  at.row = a.x;
  at.n = a.y;
  at.degree = int(a.z);
  return make_splat(at, i, uintBitsToFloat(b.y), uintBitsToFloat(b.z), splat);
}

void main() {
  record_a = uvec4(0u);
  record_b = uvec4(0u);  // not visible
  uvec2 texel = uvec2(gl_FragCoord.xy);
  if (texel.y * kRecordRow + texel.x >= count) return;
  ScreenSplat splat;
  if (!splat_of(texelFetch(order, ivec2(texel.x, first_row + texel.y), 0).x, splat)) return;
  vec3 colour = vec3(splat.colour.x, splat.colour.y, splat.colour.z);
  pack_splat(splat, is_linear ? linear_of(colour) : colour, record_a, record_b);
}
