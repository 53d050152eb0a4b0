// SPDX-License-Identifier: Apache-2.0
#version 450
#extension GL_GOOGLE_include_directive : require

#include "math_parity.h"

layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Given {
  ParityGiven given[];
};
layout(std430, binding = 1) writeonly buffer Found {
  ParityFound found[];
};

void main() {
  uint i = gl_GlobalInvocationID.x;
  if (i < given.length()) found[i] = parity_of(given[i]);
}
