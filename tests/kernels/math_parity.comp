// SPDX-License-Identifier: Apache-2.0
#version 450
#extension GL_GOOGLE_include_directive : require

#include "math_parity.h"

layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Inputs {
  ParityInput inputs[];
};
layout(std430, binding = 1) writeonly buffer Results {
  ParityResult results[];
};

void main() {
  uint i = gl_GlobalInvocationID.x;
  if (i < inputs.length()) results[i] = evaluate_parity(inputs[i]);
}
