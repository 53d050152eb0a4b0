// SPDX-License-Identifier: Apache-2.0
// Where a picture is drawn at half resolution, and what splats look like there. After frame.glsl,
// on which it builds.
#include "stgs/format/math/fovea.h"

// Whether the square of 2 x 2 tiles is.
bool square_is_halved(uint view, uvec2 square) {
  vec2 corner = vec2(square) * float(kFoveaSquare);
  return beyond_fovea(frame.view[view].fovea, frame.view[view].fovea_radius, corner.x, corner.y);
}

// The splat's first two parts on the picture of half the size.
void halve_splat(inout vec4 a, inout vec4 b) {
  const float kPerLog2 = -2.0f / 1.44269504f;
  Sym2 conic;
  conic.xx = a.z * kPerLog2;
  conic.xy = 0.5f * a.w * kPerLog2;
  conic.yy = b.x * kPerLog2;
  HalvedSplat halved = halved_splat(conic);
  a = vec4(0.5f * a.xy, halved.conic.xx / kPerLog2, 2.0f * halved.conic.xy / kPerLog2);
  b.x = halved.conic.yy / kPerLog2;
  b.y += log2(halved.scale);
}
