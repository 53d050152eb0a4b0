// SPDX-License-Identifier: Apache-2.0
// Counts the keys with each digit, per workgroup of kSortTile keys and per super group.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_ballot : require
#endif
#include "frame.glsl"

// Requires frame.glsl.
#include "digits.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 0) readonly buffer KeyBuffer {
  uint keys[];
};

const uint kEach = kSortTile / kGroup;  // keys per invocation

shared uint counts[kDigits];

void count(uint digit, bool is_valid) {
#if STGS_BALLOT
  // One invocation counts for all lanes with the digit, since the upper digits of depths are often
  // equal.
  uint matching = match_lanes(digit, subgroupBallot(is_valid).x);
  bool first = (matching & ((1u << gl_SubgroupInvocationID) - 1u)) == 0u;
  if (is_valid && first) atomicAdd(counts[digit], uint(bitCount(matching)));
#else
  if (is_valid) atomicAdd(counts[digit], 1u);
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
