// SPDX-License-Identifier: Apache-2.0
// A cube from -1 to 1 on a plate, y up. Two triangles per side, without a vertex buffer.
#version 450

layout(push_constant) uniform Push {
  mat4 clip_from_app;
};
layout(location = 0) out vec3 position;
layout(location = 1) flat out vec3 normal;

const int kCubeSides = 6;
const vec2 kCorners[6] =
    vec2[](vec2(-1, -1), vec2(1, -1), vec2(1, 1), vec2(-1, -1), vec2(1, 1), vec2(-1, 1));

void main() {
  int side = gl_VertexIndex / 6;
  vec2 corner = kCorners[gl_VertexIndex % 6];
  normal = vec3(0);
  if (side < kCubeSides) {
    int axis = side / 2;
    normal[axis] = side % 2 == 0 ? 1 : -1;
    position[axis] = normal[axis];
    position[(axis + 1) % 3] = corner.x;
    position[(axis + 2) % 3] = corner.y;
  } else {
    position = vec3(3 * corner.x, -1, 3 * corner.y);
  }
  gl_Position = clip_from_app * vec4(position, 1);
}
