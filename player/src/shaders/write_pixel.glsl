// SPDX-License-Identifier: Apache-2.0
// Writes pixels of the blend: float planes, or interleaved pixels for an image of the caller.
layout(std430, set = 1, binding = 2) writeonly buffer PixelBuffer {
  uint pixels[];
};

void write_planes(uint to, vec4 colour, float depth) {
  red_plane[to] = colour.x;
  green_plane[to] = colour.y;
  blue_plane[to] = colour.z;
  alpha_plane[to] = colour.w;
  depth_plane[to] = depth;
}

void write_packed(uint to, vec4 colour) {
  if (push.pixels == kPixelRgba8) {
    pixels[to] = packUnorm4x8(colour);
  } else if (push.pixels == kPixelBgra8) {
    pixels[to] = packUnorm4x8(colour.zyxw);
  } else if (push.pixels == kPixelRgb10) {
    uvec4 steps = uvec4(round(clamp(colour, 0.0f, 1.0f) * vec4(1023.0f, 1023.0f, 1023.0f, 3.0f)));
    pixels[to] = steps.x | steps.y << 10u | steps.z << 20u | steps.w << 30u;
  } else if (push.pixels == kPixelRgba16) {
    pixels[2u * to] = packHalf2x16(colour.xy);
    pixels[2u * to + 1u] = packHalf2x16(colour.zw);
  } else {
    for (uint c = 0u; c < 4u; ++c) pixels[4u * to + c] = floatBitsToUint(colour[c]);
  }
}

void write_pixel(uint x, uint y, vec4 sums, float t) {
  uint to = y * uint(frame.view[push.view].width) + x;
  float alpha = 1.0f - t;
  Vec3 behind = frame.view[push.view].background;
  Vec3 shown = displayed(
      vec3_of(fma(t, behind.x, sums.x), fma(t, behind.y, sums.y), fma(t, behind.z, sums.z)),
      frame.view[push.view].encoding);
  vec4 colour = vec4(shown.x, shown.y, shown.z, alpha);
  float depth = alpha > 0.0f ? sums.w / alpha : 0.0f;
  if (push.pixels == kPixelPlanes) {
    write_planes(to, colour, depth);
    return;
  }
  write_packed(to, colour);
  if (push.with_depth != 0u) depth_plane[to] = depth;
}

// Writes a square of 2 x 2 pixels, clipped to the image.
void write_square(uvec2 to, uvec2 size, vec4 sums, float t) {
  bool right = to.x + 1u < size.x, below = to.y + 1u < size.y;
  write_pixel(to.x, to.y, sums, t);
  if (right) write_pixel(to.x + 1u, to.y, sums, t);
  if (below) write_pixel(to.x, to.y + 1u, sums, t);
  if (right && below) write_pixel(to.x + 1u, to.y + 1u, sums, t);
}
