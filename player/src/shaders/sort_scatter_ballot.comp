// SPDX-License-Identifier: Apache-2.0
// sort_scatter.comp with known subgroup sizes: each subgroup ranks successive keys independently,
// as the CUDA sort does (radix_sort.cuh).
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#include "frame.glsl"

// Require frame.glsl.
#include "digits.glsl"
#include "scan.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 0) readonly buffer KeyBuffer {
  uint keys[];
};
layout(std430, set = 1, binding = 1) readonly buffer ValueBuffer {
  uint values[];
};
layout(std430, set = 1, binding = 2) writeonly buffer KeyOutBuffer {
  uint keys_out[];
};
layout(std430, set = 1, binding = 3) writeonly buffer ValueOutBuffer {
  uint values_out[];
};

const uint kEach = kSortTile / kGroup;  // keys per invocation

// First the digit counts per subgroup, then their prefix sums, finally the sorted keys and values
// of the workgroup, staged for coalesced writes.
shared uint words[2u * kSortTile];
shared uint starts[kDigits];  // first index of a digit's keys in the workgroup
shared uint shifts[kDigits];  // from an index in the workgroup to the output index

// Updates the range of a tile from one of `count` sorted keys of the workgroup. Equal keys are
// adjacent, since the earlier passes have sorted them by the other digits.
void write_range(uint index, uint count, uint tile, uint at) {
  if (tile >= tile_ranges.length()) return;
  if (index == 0u || words[index - 1u] != tile) atomicMax(tile_ranges[tile].x, ~at);
  if (index + 1u == count || words[index + 1u] != tile) atomicMax(tile_ranges[tile].y, at + 1u);
}

void main() {
  uint n = work[push.work].w, group = group_number(), thread = thread_number();
  uint first = group * kSortTile;
  if (first >= n) return;
  uint groups = (n + kSortTile - 1u) / kSortTile;
  uint lane = thread % kLanes, own = thread / kLanes * kDigits;
  // A subgroup has successive keys, so that equal keys keep their order. Padding keys sort last and
  // are not written. Issue all loads at once to hide memory latency.
  uint begin = first + thread / kLanes * kLanes * kEach + lane;
  uint own_keys[kEach], own_values[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint i = begin + k * kLanes;
    own_keys[k] = i < n ? keys[i] : ~0u;
    own_values[k] = i < n ? values[i] : 0u;
  }
  uint all, begins = digits_before(thread, group, groups, all);
  for (uint digit = lane; digit < kDigits; digit += kLanes) words[own + digit] = 0u;
  uint matching[kEach], ranks[kEach];  // lanes; index among the subgroup's keys with the digit
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    matching[k] = match_lanes(digit_of(own_keys[k]), ~0u >> (32u - kLanes));
  }
  subgroupBarrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint at = own + digit_of(own_keys[k]), before = words[at];
    uint below = uint(bitCount(matching[k] & ((1u << lane) - 1u)));
    subgroupBarrier();
    if (below == 0u) words[at] = before + uint(bitCount(matching[k]));
    subgroupBarrier();
    ranks[k] = before + below;
  }
  // sum_before() contains a barrier, after which all subgroups have counted.
  uint total, sum = 0u;
  begins += sum_before(thread, all, total);
  [[unroll]] for (uint k = 0u; k < kSubgroups; ++k) {
    uint count = words[k * kDigits + thread];
    words[k * kDigits + thread] = sum;
    sum += count;
  }
  uint start = sum_before(thread, sum, total);
  starts[thread] = start;
  shifts[thread] = begins - start;
  barrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint digit = digit_of(own_keys[k]);
    ranks[k] += starts[digit] + words[own + digit];
  }
  barrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    words[ranks[k]] = own_keys[k];
    words[kSortTile + ranks[k]] = own_values[k];
  }
  barrier();
  uint count = min(n - first, kSortTile);
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint index = k * kGroup + thread;
    if (index < count) {
      uint key = words[index], to = shifts[digit_of(key)] + index;
      if (push.writes_ranges != 0u) {
        write_range(index, count, key, to);
      } else {
        keys_out[to] = key;
      }
      values_out[to] = words[kSortTile + index];
    }
  }
}
