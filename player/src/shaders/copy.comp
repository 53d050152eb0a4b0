// SPDX-License-Identifier: Apache-2.0
// Copies words, to measure the memory bandwidth of shaders.
#version 450
#extension GL_EXT_control_flow_attributes : require

const uint kGroup = 256u, kEach = 4u;  // invocations per workgroup; vectors per invocation

layout(local_size_x = 256) in;
layout(std430, set = 0, binding = 0) readonly restrict buffer FromBuffer {
  uvec4 from_words[];
};
layout(std430, set = 0, binding = 1) writeonly restrict buffer ToBuffer {
  uvec4 to_words[];
};

void main() {
  uint first = gl_WorkGroupID.x * kGroup * kEach + gl_LocalInvocationIndex;
  uvec4 words[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) words[k] = from_words[first + k * kGroup];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) to_words[first + k * kGroup] = words[k];
}
