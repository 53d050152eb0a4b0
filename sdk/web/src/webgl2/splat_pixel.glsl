// SPDX-License-Identifier: Apache-2.0
// One splat at one pixel.
#include "stgs/format/math/screen_splat.h"

uniform vec2 origin;  // left and top edge of the image in the framebuffer, pixels

flat in vec4 splat_a;  // mean, falloff.xx, falloff.xy
flat in vec2 splat_b;  // falloff.yy, peak
flat in vec3 splat_colour;

// Returns its colour times alpha, and alpha, for blending "over" the splats behind.
vec4 splat_pixel() {
  vec2 d = vec2(gl_FragCoord.x - origin.x, origin.y - gl_FragCoord.y) - splat_a.xy;
  float falloff = d.x * (splat_a.z * d.x + splat_a.w * d.y) + splat_b.x * d.y * d.y;
  float log2_alpha = splat_b.y + min(0.0, falloff);
  if (log2_alpha < kLog2Threshold) discard;
  float alpha = exp2(min(log2_alpha, kLog2AlphaMax));
  return vec4(splat_colour * alpha, alpha);
}
