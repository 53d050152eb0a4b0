// SPDX-License-Identifier: Apache-2.0
// Computes the splats of primitives at the time of the frame, as project.comp of the native renderer
// does. Each primitive of the segments of the frame has a slot; segments have consecutive slots, in
// ascending order of their ids. pipelines.ts writes kViews, the most views of a frame, before this text.
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "stgs/format/math/screen_splat.h"
#include "stgs/format/math/sh.h"
#include "../splat_view.h"
#include "drawn.wgsl"
#include "record.wgsl"
#include "view.wgsl"

struct Segment {
  first: u32,       // of its pairs of words in the page
  n: u32,           // entries per array, a multiple of 256 (packed_segment.h)
  degree: u32,
  slot: u32,        // the first
  primitives: u32,
  ticks: f32,       // the time of the frame from its origin, and the rounding error of that
  ticks_rest: f32,
  slots: u32,       // of all segments of the frame
}

@group(0) @binding(0) var<uniform> views: array<View, kViews>;
@group(0) @binding(1) var<storage, read> segments: array<Segment>;
// View by view, per slot: the bits of its depth, or kHole; and its splat.
@group(0) @binding(2) var<storage, read_write> depths: array<u32>;
@group(0) @binding(3) var<storage, read_write> records: array<Record>;
// The packed segments of a page: pairs of 32-bit words.
@group(1) @binding(0) var<storage, read> words: array<vec2<u32>>;
// Per 256 entries of these segments: index into `segments`, number of the 256 in the segment.
@group(1) @binding(1) var<storage, read> groups: array<vec2<u32>>;

// The current one, for splat_view.h.
var<private> view: array<vec4<f32>, 6>;

fn pair_at(pair: u32) -> vec2<f32> {
  return bitcast<vec2<f32>>(words[pair]);
}

// Reads element i of an array of four floats that begins at `pair`.
fn four_at(pair: u32, i: u32) -> vec4<f32> {
  return vec4<f32>(pair_at(pair + 2u * i), pair_at(pair + 2u * i + 1u));
}

// Four SH numbers of primitive i.
fn sh_plane(at: Segment, i: u32, plane: u32) -> vec4<f32> {
  let bits = words[at.first + (9u + plane) * at.n + i];
  return vec4<f32>(unpack2x16float(bits.x), unpack2x16float(bits.y));
}

// Sum over four coefficients of three channels, which are stored in three planes.
fn sh_block(at: Segment, i: u32, block: u32, basis: vec4<f32>) -> vec3<f32> {
  let a = sh_plane(at, i, 3u * block);
  let b = sh_plane(at, i, 3u * block + 1u);
  let c = sh_plane(at, i, 3u * block + 2u);
  return basis.x * a.xyz + basis.y * vec3<f32>(a.w, b.xy) + basis.z * vec3<f32>(b.zw, c.x) +
         basis.w * c.yzw;
}

struct Colour {
  rgb: vec3<f32>,
  is_valid: bool,  // the distance and all sums of the SH coefficients are finite (representation 4.6)
}

fn colour_of(at: Segment, i: u32, from_camera: Vec3) -> Colour {
  let square = dot3(from_camera, from_camera);
  let n = 1.0 / sqrt(square);
  let b = sh_basis(vec3_of(from_camera.x * n, from_camera.y * n, from_camera.z * n));
  var sums: vec3<f32>;
  if (at.degree == 0u) {
    sums = b.v[0] * sh_plane(at, i, 0u).xyz;
  } else {
    sums = sh_block(at, i, 0u, vec4<f32>(b.v[0], b.v[1], b.v[2], b.v[3]));
    if (at.degree >= 2u) {
      sums += sh_block(at, i, 1u, vec4<f32>(b.v[4], b.v[5], b.v[6], b.v[7]));
    }
    if (at.degree == 2u) {
      sums += b.v[8] * sh_plane(at, i, 6u).xyz;
    }
    if (at.degree >= 3u) {
      sums += sh_block(at, i, 2u, vec4<f32>(b.v[8], b.v[9], b.v[10], b.v[11]));
      sums += sh_block(at, i, 3u, vec4<f32>(b.v[12], b.v[13], b.v[14], b.v[15]));
    }
  }
  var colour: Colour;
  colour.rgb = vec3<f32>(sh_colour(sums.x), sh_colour(sums.y), sh_colour(sums.z));
  colour.is_valid =
      is_finite(square) && is_finite(sums.x) && is_finite(sums.y) && is_finite(sums.z);
  return colour;
}

fn covariance_at(at: Segment, i: u32) -> Sym3 {
  let c = four_at(at.first + 6u * at.n, i);
  let rest = pair_at(at.first + 8u * at.n + i);
  return Sym3(c.x, c.y, c.z, c.w, rest.x, rest.y);
}

fn record_of(splat: ScreenSplat) -> Record {
  let red_green = min(vec2<f32>(splat.colour.x, splat.colour.y), vec2<f32>(kMaxHalf));
  // Enlarged, so that its rounding cuts nothing.
  let extent = min(splat.extent.x * (1.0 + 1.0 / 1024.0), kMaxHalf);
  let mean = vec2<f32>(splat.mean.x, splat.mean.y);
  let falloff = vec2<f32>(splat.falloff.xx, splat.falloff.xy);
  return Record(bitcast<vec4<u32>>(vec4<f32>(mean, falloff)),
                vec4<u32>(bitcast<u32>(splat.falloff.yy), bitcast<u32>(splat.peak),
                          pack2x16float(red_green),
                          pack2x16float(vec2<f32>(min(splat.colour.z, kMaxHalf), extent))));
}

// A primitive at the time of the frame.
struct Gaussian {
  position: Vec3,
  opacity: f32,  // less than kAlphaThreshold: it is not visible
}

fn gaussian_at(at: Segment, i: u32) -> Gaussian {
  var gaussian: Gaussian;
  let support = pair_at(at.first + i);
  if (!(support.x <= at.ticks && at.ticks <= support.y)) { return gaussian; }
  let position_time = four_at(at.first + at.n, i);
  let velocity_opacity = four_at(at.first + 3u * at.n, i);
  let lifespan = pair_at(at.first + 5u * at.n + i);
  let dt = since(at.ticks, at.ticks_rest, position_time.w);
  gaussian.opacity = velocity_opacity.w * visibility(dt, lifespan.x, lifespan.y);
  gaussian.position = position_at(
      vec3_of(position_time.x, position_time.y, position_time.z),
      vec3_of(velocity_opacity.x, velocity_opacity.y, velocity_opacity.z), dt);
  return gaussian;
}

// Writes the record of primitive i in the current view. Returns the bits of its depth, or kHole if it is
// not visible.
fn make_splat(at: Segment, i: u32, gaussian: Gaussian, record: u32) -> u32 {
  if (!(gaussian.opacity >= kAlphaThreshold)) { return kHole; }
  let position = gaussian.position;
  let camera = camera_of_view();
  if (!(to_camera(camera, position).z >= camera.near_plane)) { return kHole; }
  let kernel = kernel_of_view();
  let p = project_gaussian(camera, position, covariance_at(at, i), screen_blur(kernel));
  let opacity = splat_opacity(kernel, gaussian.opacity, p);
  let box = splat_box(camera, p, opacity);
  if (box.visible == 0) { return kHole; }
  let colour = colour_of(at, i, vec3_of(position.x - view[5].x, position.y - view[5].y,
                                        position.z - view[5].z));
  if (!colour.is_valid) { return kHole; }
  let rgb = vec3_of(colour.rgb.x, colour.rgb.y, colour.rgb.z);
  records[record] = record_of(screen_splat(p, box.extent, opacity, rgb));
  return bitcast<u32>(p.depth);
}

@compute @workgroup_size(256)
fn project(@builtin(workgroup_id) workgroup: vec3<u32>,
           @builtin(num_workgroups) workgroups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
  let g = workgroup.y * workgroups.x + workgroup.x;
  if (g >= arrayLength(&groups)) { return; }
  let segment = segments[groups[g].x];
  let i = 256u * groups[g].y + lane;
  var gaussian: Gaussian;
  if (i < segment.primitives) { gaussian = gaussian_at(segment, i); }
  for (var v = 0u; v < min(kViews, views[0].views); v++) {
    view = views[v].rows;
    let to = v * segment.slots + segment.slot + i;
    depths[to] = make_splat(segment, i, gaussian, to);
  }
}
