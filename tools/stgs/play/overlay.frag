// SPDX-License-Identifier: Apache-2.0
// Colour, weighted by the coverage of the glyph.
#version 450

layout(location = 0) in vec4 colour;
layout(location = 1) in vec2 at_glyph;
layout(set = 0, binding = 0) uniform sampler2D glyphs;

layout(location = 0) out vec4 out_colour;

void main() {
  out_colour = vec4(colour.rgb, colour.a * texture(glyphs, at_glyph).r);
}
