// SPDX-License-Identifier: Apache-2.0
// The splat of one primitive in a frame, 32 bytes in two textures, between project.frag.glsl and
// splat.vert.glsl:
//   a    bits of the floats mean.x, mean.y, falloff.xx, falloff.xy (screen_splat.h)
//   b.x  bits of the float falloff.yy
//   b.y  half floats red, green
//   b.z  half float blue; peak in the upper 16 bits
//   b.w  extent.x in the lower kExtentBits; the other bits are the leading bits of the depth
// Some mobile GPUs write at most 256 bits per fragment.
#include "stgs/format/math/screen_splat.h"

const uint kRecordRow = 4096u;  // records per row, as in records.ts
const float kMaxHalf = 65504.0;
// Peaks are from -8, since kLog2Threshold is more, to 0, with 16 bits.
const float kPeakSteps = 65535.0 / -8.0;
// Extents are rounded up to steps of 2^(1/28) from 2^-2 pixels; 0: the splat is not visible.
const uint kExtentBits = 9u, kExtentMask = (1u << kExtentBits) - 1u;
const float kExtentSteps = 28.0, kExtentFirst = -2.0;
const float kExtentSlack = 0.05;  // of a step, for the rounding of log2
// In place of the extents beyond the last step: more than the size of any image.
const float kMaxExtent = 1e9;

// A splat of a record.
struct Splat {
  vec2 mean;
  Falloff falloff;
  float peak;
  float extent;  // half width of its bounding box, pixels
  vec3 colour;
  float depth;
};

void pack_splat(ScreenSplat splat, vec3 colour, out uvec4 a, out uvec4 b) {
  a = floatBitsToUint(vec4(splat.mean.x, splat.mean.y, splat.falloff.xx, splat.falloff.xy));
  vec3 half_colour = min(colour, kMaxHalf);
  uint peak = uint(clamp(round(kPeakSteps * splat.peak), 0.0, 65535.0));
  float steps = kExtentSteps * (log2(splat.extent.x) - kExtentFirst) + kExtentSlack;
  uint extent = uint(clamp(ceil(steps), 1.0, float(kExtentMask)));
  uint depth = floatBitsToUint(splat.depth) + (kExtentMask + 1u) / 2u;  // rounds to nearest
  b = uvec4(floatBitsToUint(splat.falloff.yy), packHalf2x16(half_colour.xy),
            packHalf2x16(vec2(half_colour.z, 0.0)) | peak << 16u, (depth & ~kExtentMask) | extent);
}

bool is_visible(uvec4 b) {
  return (b.w & kExtentMask) != 0u;
}

Splat unpack_splat(uvec4 a, uvec4 b) {
  vec4 floats = uintBitsToFloat(a);
  uint steps = b.w & kExtentMask;
  Splat splat;
  splat.mean = floats.xy;
  splat.falloff.xx = floats.z;
  splat.falloff.xy = floats.w;
  splat.falloff.yy = uintBitsToFloat(b.x);
  splat.peak = float(b.z >> 16u) / kPeakSteps;
  splat.extent =
      steps == kExtentMask ? kMaxExtent : exp2(float(steps) / kExtentSteps + kExtentFirst);
  splat.colour = vec3(unpackHalf2x16(b.y), unpackHalf2x16(b.z & 0xffffu).x);
  splat.depth = uintBitsToFloat(b.w & ~kExtentMask);
  return splat;
}
