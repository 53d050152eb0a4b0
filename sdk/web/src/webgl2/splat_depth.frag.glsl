// SPDX-License-Identifier: Apache-2.0
// Blends the colours of splats, and sums their depths with the weights of the colours.
#include "splat_pixel.glsl"

const float kMaxDepth = 65504.0;  // of half floats

flat in float splat_depth;

layout(location = 0) out vec4 pixel;
layout(location = 1) out vec4 sums;  // depth times alpha, alpha; in w alpha for blending

void main() {
  pixel = splat_pixel();
  sums = vec4(min(splat_depth, kMaxDepth) * pixel.w, pixel.w, 0.0, pixel.w);
}
