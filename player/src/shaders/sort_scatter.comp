// SPDX-License-Identifier: Apache-2.0
// Moves each workgroup's kSortTile keys to their places, in the order in which they are. Workgroups
// wait for none: a kernel before has counted what all of them have.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
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

const uint kBits = 32u;  // bits of a word
const uint kWords = kGroup / kBits;
const uint kEach = kSortTile / kGroup;  // keys of an invocation

// Of the keys that are moved at once, a bit each where it has the digit.
shared uint having[kDigits * kWords];
shared uint places[kDigits];  // of the next key with the digit

void main() {
  uint n = work[push.work].w, group = group_number(), thread = thread_number();
  uint first = group * kSortTile;
  if (first >= n) return;
  uint groups = (n + kSortTile - 1u) / kSortTile;
  uint all, total, before = digits_before(thread, group, groups, all);
  places[thread] = before + sum_before(thread, all, total);
  for (uint k = 0u; k < kWords; ++k) having[thread * kWords + k] = 0u;
  barrier();
  // All are asked for at once: what is waited for is memory.
  uint own_keys[kEach], own_values[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint i = first + k * kGroup + thread;
    own_keys[k] = i < n ? keys[i] : 0u;
    own_values[k] = i < n ? values[i] : 0u;
  }
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    bool there = first + k * kGroup + thread < n;
    uint key = own_keys[k], digit = digit_of(key);
    if (there) atomicOr(having[digit * kWords + thread / kBits], 1u << (thread % kBits));
    barrier();
    if (there) {
      uint word = thread / kBits;
      uint to = places[digit];
      for (uint w = 0u; w < word; ++w) to += uint(bitCount(having[digit * kWords + w]));
      to += uint(bitCount(having[digit * kWords + word] & ((1u << (thread % kBits)) - 1u)));
      keys_out[to] = key;
      values_out[to] = own_values[k];
    }
    barrier();
    uint more = 0u;
    for (uint w = 0u; w < kWords; ++w) {
      more += uint(bitCount(having[thread * kWords + w]));
      having[thread * kWords + w] = 0u;
    }
    places[thread] += more;
    barrier();
  }
}
