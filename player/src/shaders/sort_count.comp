// SPDX-License-Identifier: Apache-2.0
// How many keys of each workgroup's kSortTile, and of each super group's, have each digit.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_ballot : require
#endif
#include "frame.glsl"

// After frame.glsl, on which it builds.
#include "digits.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 0) readonly buffer KeyBuffer {
  uint keys[];
};

const uint kEach = kSortTile / kGroup;  // keys of an invocation

shared uint counts[kDigits];

void count(uint digit, bool there) {
#if STGS_BALLOT
  // One invocation for all of its subgroup with the digit, which the upper ones of a depth often
  // share.
  uint alike = lanes_alike(digit, subgroupBallot(there).x);
  bool first = (alike & ((1u << gl_SubgroupInvocationID) - 1u)) == 0u;
  if (there && first) atomicAdd(counts[digit], uint(bitCount(alike)));
#else
  if (there) atomicAdd(counts[digit], 1u);
#endif
}

void main() {
  uint n = work[push.work].w, group = group_number(), thread = gl_LocalInvocationIndex;
  uint first = group * kSortTile;
  if (first >= n) return;
  counts[thread] = 0u;
  uint own_keys[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint i = first + k * kGroup + thread;
    own_keys[k] = i < n ? keys[i] : 0u;
  }
  barrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    count(digit_of(own_keys[k]), first + k * kGroup + thread < n);
  }
  barrier();
  uint groups = (n + kSortTile - 1u) / kSortTile, own = counts[thread];
  uint super_group = push.super_rows + group / super_group_of(groups);
  digit_counts[group * kDigits + thread] = own;
  if (own != 0u) atomicAdd(digit_counts[super_group * kDigits + thread], own);
}
