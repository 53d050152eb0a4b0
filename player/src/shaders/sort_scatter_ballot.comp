// SPDX-License-Identifier: Apache-2.0
// sort_scatter.comp where subgroups are known: each ranks successive keys by itself, as the passes
// of CUDA's sort do (radix_sort.cuh).
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#include "frame.glsl"

// After frame.glsl, on which they build.
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

const uint kEach = kSortTile / kGroup;  // keys of an invocation

// First how many keys each subgroup has of each digit, then those of its keys that come before;
// at last the workgroup's keys and their values, sorted, from where they are written side by side.
shared uint words[2u * kSortTile];
shared uint starts[kDigits];  // of a digit's keys in the workgroup
shared uint shifts[kDigits];  // from a place in the workgroup to that among all keys

// What a key of the workgroup's `count` tells of its tile's instances: successive, as the passes
// before have sorted them by the other digits.
void tell_range(uint place, uint count, uint tile, uint at) {
  if (tile >= tile_ranges.length()) return;
  if (place == 0u || words[place - 1u] != tile) atomicMax(tile_ranges[tile].x, ~at);
  if (place + 1u == count || words[place + 1u] != tile) atomicMax(tile_ranges[tile].y, at + 1u);
}

void main() {
  uint n = work[push.work].w, group = group_number(), thread = thread_number();
  uint first = group * kSortTile;
  if (first >= n) return;
  uint groups = (n + kSortTile - 1u) / kSortTile;
  uint lane = thread % kLanes, own = thread / kLanes * kDigits;
  // A subgroup has successive keys, so that equal ones keep their order. Those that are not there
  // come last of all, whatever is counted of them. All are asked for at once: what is waited for is
  // memory.
  uint begin = first + thread / kLanes * kLanes * kEach + lane;
  uint own_keys[kEach], own_values[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint i = begin + k * kLanes;
    own_keys[k] = i < n ? keys[i] : ~0u;
    own_values[k] = i < n ? values[i] : 0u;
  }
  uint all, begins = digits_before(thread, group, groups, all);
  for (uint digit = lane; digit < kDigits; digit += kLanes) words[own + digit] = 0u;
  uint alike[kEach], ranks[kEach];  // lanes; places among the subgroup's keys with the digit
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    alike[k] = lanes_alike(digit_of(own_keys[k]), ~0u >> (32u - kLanes));
  }
  subgroupBarrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint at = own + digit_of(own_keys[k]), before = words[at];
    uint below = uint(bitCount(alike[k] & ((1u << lane) - 1u)));
    subgroupBarrier();
    if (below == 0u) words[at] = before + uint(bitCount(alike[k]));
    subgroupBarrier();
    ranks[k] = before + below;
  }
  // sum_before waits for all, which have counted then.
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
    uint place = k * kGroup + thread;
    if (place < count) {
      uint key = words[place], to = shifts[digit_of(key)] + place;
      if (push.tells_ranges != 0u) {
        tell_range(place, count, key, to);
      } else {
        keys_out[to] = key;
      }
      values_out[to] = words[kSortTile + place];
    }
  }
}
