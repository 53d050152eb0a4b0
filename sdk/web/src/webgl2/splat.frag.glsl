// SPDX-License-Identifier: Apache-2.0
// Blends the colours of splats.
#include "splat_pixel.glsl"

layout(location = 0) out vec4 pixel;

void main() {
  pixel = splat_pixel();
}
