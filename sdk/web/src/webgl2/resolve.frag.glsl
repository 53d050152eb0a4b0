// SPDX-License-Identifier: Apache-2.0
// Puts the blended splats over the background. Colours are sRGB-encoded, as the canvas is.
precision highp sampler2D;

uniform sampler2D image;
uniform ivec2 origin;     // of the image in the framebuffer, pixels
uniform vec4 background;  // premultiplied

layout(location = 0) out vec4 pixel;

void main() {
  vec4 sums = texelFetch(image, ivec2(gl_FragCoord.xy) - origin, 0);
  pixel = sums + (1.0 - sums.w) * background;
}
