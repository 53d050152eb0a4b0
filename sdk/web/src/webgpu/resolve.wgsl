// SPDX-License-Identifier: Apache-2.0
// Puts the blended splats over the background, and divides the sums of depths by alpha. Colours are
// sRGB-encoded, as the canvas is.
#include "view.wgsl"

@group(0) @binding(0) var image: texture_2d<f32>;
@group(0) @binding(1) var<uniform> view: View;

// A triangle that covers the image.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
  let corner = vec2<f32>(vec2<u32>((index & 1u) * 4u, (index & 2u) * 2u)) - 1.0;
  return vec4<f32>(corner, 0.0, 1.0);
}

@fragment
fn resolve(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
  let sums = textureLoad(image, vec2<i32>(at.xy - view.origin), 0);
  return sums + (1.0 - sums.w) * view.background;
}

// The mean camera z; 0 where alpha is 0.
@fragment
fn resolve_depth(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
  let sums = textureLoad(image, vec2<i32>(at.xy), 0);
  return vec4<f32>(select(0.0, sums.x / sums.y, sums.y > 0.0), 0.0, 0.0, 1.0);
}
