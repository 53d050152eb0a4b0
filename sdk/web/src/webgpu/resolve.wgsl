// SPDX-License-Identifier: Apache-2.0
// Puts the blended splats over the background, or over the content of a texture, and divides the sums
// of depths by alpha. Colours are premultiplied and sRGB-encoded, as the canvas is, or linear.
// pipelines.ts writes the type Image of a texture with one or several samples per pixel before this text.
#include "view.wgsl"

@group(0) @binding(0) var image: Image;
@group(0) @binding(1) var<uniform> view: View;
@group(0) @binding(2) var content: Image;  // of the texture, linear

// A triangle that covers the image.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
  let corner = vec2<f32>(vec2<u32>((index & 1u) * 4u, (index & 2u) * 2u)) - 1.0;
  return vec4<f32>(corner, 0.0, 1.0);
}

// With one sample per pixel, `number` is 0, which is also the level of the texture.
fn sums_at(at: vec4<f32>, number: u32) -> vec4<f32> {
  return textureLoad(image, vec2<i32>(at.xy - view.origin), i32(number));
}

fn encoded_of(linear: vec3<f32>) -> vec3<f32> {
  let curve = 1.055 * pow(max(linear, vec3<f32>(0.0)), vec3<f32>(1.0 / 2.4)) - 0.055;
  return select(curve, 12.92 * linear, linear <= vec3<f32>(0.0031308));
}

// Of a premultiplied, encoded colour.
fn linear_of(colour: vec4<f32>) -> vec4<f32> {
  let encoded = colour.rgb / max(colour.a, 1e-6);
  let curve = pow(max((encoded + 0.055) / 1.055, vec3<f32>(0.0)), vec3<f32>(2.4));
  return vec4<f32>(colour.a * select(curve, encoded / 12.92, encoded <= vec3<f32>(0.04045)), colour.a);
}

fn over_background(at: vec4<f32>, number: u32) -> vec4<f32> {
  let sums = sums_at(at, number);
  return sums + (1.0 - sums.w) * view.background;
}

@fragment
fn resolve(
    @builtin(position) at: vec4<f32>, @builtin(sample_index) number: u32) -> @location(0) vec4<f32> {
  return over_background(at, number);
}

@fragment
fn resolve_linear(
    @builtin(position) at: vec4<f32>, @builtin(sample_index) number: u32) -> @location(0) vec4<f32> {
  return linear_of(over_background(at, number));
}

// The splats alone.
@fragment
fn overlay(
    @builtin(position) at: vec4<f32>, @builtin(sample_index) number: u32) -> @location(0) vec4<f32> {
  return sums_at(at, number);
}

// Blends over the content as if it were encoded. Pixels without splats keep their value.
@fragment
fn overlay_linear(
    @builtin(position) at: vec4<f32>, @builtin(sample_index) number: u32) -> @location(0) vec4<f32> {
  let sums = sums_at(at, number);
  if (sums.w <= 0.0) { discard; }
  let behind = textureLoad(content, vec2<i32>(at.xy), i32(number));
  let encoded = encoded_of(behind.rgb / max(behind.a, 1e-6));
  return linear_of(sums + (1.0 - sums.w) * vec4<f32>(behind.a * encoded, behind.a));
}

// The mean camera z; 0 where alpha is 0.
@fragment
fn resolve_depth(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
  let sums = textureLoad(image, vec2<i32>(at.xy), 0);
  return vec4<f32>(select(0.0, sums.x / sums.y, sums.y > 0.0), 0.0, 0.0, 1.0);
}
