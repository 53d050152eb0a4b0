// SPDX-License-Identifier: Apache-2.0
// How many keys of each workgroup's kSortTile have each digit; by digit, then by workgroup.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 0) readonly buffer KeyBuffer {
  uint keys[];
};

shared uint counts[kDigits];

void main() {
  uint n = work[push.work].w, group = group_number(), thread = gl_LocalInvocationIndex;
  uint first = group * kSortTile;
  if (first >= n) return;
  counts[thread] = 0u;
  barrier();
  [[unroll]] for (uint k = thread; k < kSortTile; k += kGroup) {
    if (first + k < n) atomicAdd(counts[keys[first + k] >> push.shift & (kDigits - 1u)], 1u);
  }
  barrier();
  uint groups = (n + kSortTile - 1u) / kSortTile;
  digit_places[thread * groups + group] = counts[thread];
}
