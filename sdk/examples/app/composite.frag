// SPDX-License-Identifier: Apache-2.0
// Premultiplied pixels of the scene, each at its depth. The depth test hides pixels behind the
// application's geometry; blending composites the others over it.
#version 450

layout(push_constant) uniform Push {
  float near_plane;
};
layout(set = 0, binding = 0) uniform sampler2D scene_colour;
layout(set = 0, binding = 1) uniform sampler2D scene_depth;
layout(location = 0) out vec4 colour;

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  colour = texelFetch(scene_colour, at, 0);
  if (colour.a == 0) discard;
  // Like the geometry: 1 at the near plane, 0 at infinity.
  gl_FragDepth = near_plane / texelFetch(scene_depth, at, 0).r;
}
