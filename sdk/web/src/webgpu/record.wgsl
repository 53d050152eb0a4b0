// SPDX-License-Identifier: Apache-2.0
// The splat of one primitive in a frame, 32 bytes, between project.wgsl and splat.wgsl.

struct Record {
  // Bits of floats: mean, falloff.xx, falloff.xy (screen_splat.h).
  a: vec4<u32>,
  // Bits of falloff.yy and peak; half floats red and green, blue and extent.x.
  b: vec4<u32>,
}

const kMaxHalf = 65504.0;
// Extents from here on may exceed the range of half floats.
const kMaxExtent = 60000.0;
