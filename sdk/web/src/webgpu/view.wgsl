// SPDX-License-Identifier: Apache-2.0
// A view of the frame, 256 bytes, as view_buffer.ts writes it.

struct View {
  rows: array<vec4<f32>, 6>,  // `view` of splat_view.h
  depth_mapping: vec4<f32>,   // (a, b, c, d): a splat at z has the depth a + b / z + c log2(d + z)
  background: vec4<f32>,      // premultiplied
  origin: vec2<f32>,          // of the image in the texture, pixels
  @size(120) views: u32,      // of the frame
}
