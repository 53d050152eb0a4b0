// SPDX-License-Identifier: Apache-2.0
// The mean camera z of the splats of a pixel; 0 where there are none.
precision highp sampler2D;

uniform sampler2D sums;  // depth times alpha, alpha

layout(location = 0) out vec4 depth;

void main() {
  vec4 sum = texelFetch(sums, ivec2(gl_FragCoord.xy), 0);
  depth = vec4(sum.y > 0.0 ? sum.x / sum.y : 0.0, 0.0, 0.0, 1.0);
}
