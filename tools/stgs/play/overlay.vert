// SPDX-License-Identifier: Apache-2.0
// Dear ImGui vertices: pixels to clip space.
#version 450

layout(location = 0) in vec2 at;
layout(location = 1) in vec2 at_glyph;
layout(location = 2) in vec4 colour;

layout(push_constant) uniform PushBlock {
  vec2 scale, shift;
};

layout(location = 0) out vec4 out_colour;
layout(location = 1) out vec2 out_glyph;

void main() {
  out_colour = colour;
  out_glyph = at_glyph;
  gl_Position = vec4(at * scale + shift, 0.0f, 1.0f);
}
