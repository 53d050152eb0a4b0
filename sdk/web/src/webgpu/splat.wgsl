// SPDX-License-Identifier: Apache-2.0
// Draws splats, farthest first: for each, a rectangle around the pixels that it covers. An instance
// has several of them.
#include "stgs/format/math/screen_splat.h"
#include "drawn.wgsl"
#include "record.wgsl"
#include "view.wgsl"

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> records: array<Record>;
// Nearest first: key and slot.
@group(0) @binding(2) var<storage, read> order: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> drawn: array<u32, kDrawnWords>;  // of sort.wgsl
@group(0) @binding(4) var<storage, read> depths: array<f32>;  // of slots

// Enlarges rectangles that are not aligned to pixels, for the rounding of their corners; pixels.
const kBoxMargin = 0.0625;
const kRelativeError = 1e-6;  // of their sizes
// Upper limit of depths, so that their sums fit the format of the target (pipelines.ts).
override kMaxDepth = 0x1.fffffep+127f;

struct Vertex {
  @builtin(position) position: vec4<f32>,
  @location(0) @interpolate(flat) a: vec4<f32>,  // mean, falloff.xx, falloff.xy
  @location(1) @interpolate(flat) b: vec3<f32>,  // falloff.yy, peak, depth
  @location(2) @interpolate(flat) colour: vec3<f32>,
}

// Returns the corner, on a side of -1 or 1 of each axis, of a rectangle that contains all visible
// pixels of a splat: its bounding box in the image, or, if that is larger, the box along the axes of
// its ellipse.
fn corner_at(mean: vec2<f32>, extent: vec2<f32>, conic: Sym2, side: vec2<f32>) -> vec2<f32> {
  // Edges of the pixels whose centres are in the box, so that rounding at its edges cuts nothing.
  let low = max(ceil(mean - extent - 0.5), vec2<f32>(0.0));
  let high = max(low, min(floor(mean + extent + 0.5), view.rows[4].xy));
  let corner = mix(low, high, 0.5 * side + 0.5);
  // The covariance is (yy, -xy, xx) of the conic, times its determinant. The squared half sizes
  // along the axes of the ellipse are its eigenvalues, times the scale that makes a box of `extent`.
  let trace = conic.xx + conic.yy;
  let difference = conic.yy - conic.xx;
  let root = sqrt(difference * difference + 4.0 * conic.xy * conic.xy);
  let scale = extent.x * extent.x / conic.yy;
  let squares = vec2<f32>(trace + root, max(0.0, trace - root) + kRelativeError * trace);
  let half_size = sqrt(0.5 * scale * squares) + kBoxMargin;
  let area = (high.x - low.x) * (high.y - low.y);
  let is_smaller = root > 0.0 && 4.0 * half_size.x * half_size.y < area;
  if (!is_smaller || extent.x > kMaxExtent) { return corner; }
  // The long axis, in the more precise of two forms.
  var along = vec2<f32>(-2.0 * conic.xy, root - difference);
  if (difference >= 0.0) { along = vec2<f32>(difference + root, -2.0 * conic.xy); }
  along = normalize(along);
  return mean + side.x * half_size.x * along + side.y * half_size.y * vec2<f32>(-along.y, along.x);
}

@vertex
fn corner(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Vertex {
  var out: Vertex;
  out.position = vec4<f32>(2.0, 2.0, 0.0, 1.0);  // outside the image: nothing is drawn
  let entry = instance * kQuads + index / 4u;
  if (entry >= drawn[kCount]) { return out; }
  let slot = order[drawn[kCount] - 1u - entry].y;
  let record = records[slot];
  let depth = depths[slot];
  out.a = bitcast<vec4<f32>>(record.a);
  out.b = vec3<f32>(bitcast<vec2<f32>>(record.b.xy), depth);
  let red_green = unpack2x16float(record.b.z);
  let blue_extent = unpack2x16float(record.b.w);
  out.colour = vec3<f32>(red_green, blue_extent.x);
  let conic = conic_of(Falloff(out.a.z, out.a.w, out.b.x));
  let extent = blue_extent.y * vec2<f32>(1.0, sqrt(conic.xx / conic.yy));
  let side = vec2<f32>(vec2<u32>(index & 1u, (index >> 1u) & 1u)) * 2.0 - 1.0;
  let clip = 2.0 * corner_at(out.a.xy, extent, conic, side) / view.rows[4].xy - 1.0;
  let mapping = view.depth_mapping;
  let mapped = mapping.x + mapping.y / depth + mapping.z * log2(mapping.w + depth);
  // Clamped, so that splats beyond the planes of the application's projection are drawn.
  out.position = vec4<f32>(clip.x, -clip.y, clamp(mapped, 0.0, 1.0), 1.0);
  return out;
}

fn log2_alpha_at(splat: Vertex) -> f32 {
  let d = splat.position.xy - splat.a.xy;
  let falloff = d.x * (splat.a.z * d.x + splat.a.w * d.y) + splat.b.x * d.y * d.y;
  return splat.b.y + min(0.0, falloff);
}

// One splat at one pixel: its colour times alpha, and alpha, for blending "over" the splats behind.
fn colour_at(splat: Vertex) -> vec4<f32> {
  let log2_alpha = log2_alpha_at(splat);
  if (log2_alpha < kLog2Threshold) { discard; }
  let alpha = exp2(min(log2_alpha, kLog2AlphaMax));
  return vec4<f32>(splat.colour * alpha, alpha);
}

@fragment
fn blend(splat: Vertex) -> @location(0) vec4<f32> {
  return colour_at(splat);
}

struct Sums {
  @location(0) colour: vec4<f32>,
  @location(1) depth: vec4<f32>,  // depth times alpha, alpha; in w alpha for blending
}

@fragment
fn blend_depth(splat: Vertex) -> Sums {
  let colour = colour_at(splat);
  return Sums(colour, vec4<f32>(min(splat.b.z, kMaxDepth) * colour.w, colour.w, 0.0, colour.w));
}

// For overdraw.ts: counts the fragments of a pixel, and those that blend() does not discard.
@fragment
fn tally(splat: Vertex) -> @location(0) vec4<f32> {
  return vec4<f32>(1.0, f32(log2_alpha_at(splat) >= kLog2Threshold), 0.0, 0.0);
}
