// SPDX-License-Identifier: Apache-2.0
// An orange cube and a chequered plate. Colours are sRGB-encoded, like those of the splats.
#version 450

layout(location = 0) in vec3 position;
layout(location = 1) flat in vec3 normal;
layout(location = 0) out vec4 colour;

void main() {
  if (normal == vec3(0)) {
    vec2 square = floor(position.xz);
    colour = vec4(vec3(mod(square.x + square.y, 2) == 0 ? 0.75 : 0.45), 1);
  } else {
    colour = vec4(vec3(1.0, 0.55, 0.1) * (0.75 + dot(normal, vec3(0.1, 0.2, 0.05))), 1);
  }
}
