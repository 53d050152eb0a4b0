// SPDX-License-Identifier: Apache-2.0
// Scatters the kSortTile keys of each workgroup to their sorted positions, stably. Workgroups do
// not wait for each other: sort_count.comp has counted the digits of all.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
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

const uint kBits = 32u;  // bits of a word
const uint kWords = kGroup / kBits;
const uint kEach = kSortTile / kGroup;  // keys per invocation

// Per digit, one bit per key of the current batch that has it.
shared uint digit_bits[kDigits * kWords];
shared uint next_index[kDigits];  // output index of the next key with the digit

void main() {
  uint n = work[push.work].w, group = group_number(), thread = thread_number();
  uint first = group * kSortTile;
  if (first >= n) return;
  uint groups = (n + kSortTile - 1u) / kSortTile;
  uint all, total, before = digits_before(thread, group, groups, all);
  next_index[thread] = before + sum_before(thread, all, total);
  for (uint k = 0u; k < kWords; ++k) digit_bits[thread * kWords + k] = 0u;
  barrier();
  // Issue all loads at once to hide memory latency.
  uint own_keys[kEach], own_values[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint i = first + k * kGroup + thread;
    own_keys[k] = i < n ? keys[i] : 0u;
    own_values[k] = i < n ? values[i] : 0u;
  }
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    bool is_valid = first + k * kGroup + thread < n;
    uint key = own_keys[k], digit = digit_of(key);
    if (is_valid) atomicOr(digit_bits[digit * kWords + thread / kBits], 1u << (thread % kBits));
    barrier();
    if (is_valid) {
      uint word = thread / kBits;
      uint to = next_index[digit];
      for (uint w = 0u; w < word; ++w) to += uint(bitCount(digit_bits[digit * kWords + w]));
      to += uint(bitCount(digit_bits[digit * kWords + word] & ((1u << (thread % kBits)) - 1u)));
      keys_out[to] = key;
      values_out[to] = own_values[k];
    }
    barrier();
    uint more = 0u;
    for (uint w = 0u; w < kWords; ++w) {
      more += uint(bitCount(digit_bits[thread * kWords + w]));
      digit_bits[thread * kWords + w] = 0u;
    }
    next_index[thread] += more;
    barrier();
  }
}
