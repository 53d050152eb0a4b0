// SPDX-License-Identifier: Apache-2.0
// Moves each workgroup's kSortTile keys to their places, in the order in which they are. Workgroups
// wait for none: a kernel before has counted what all of them have. Where there is shared memory
// for it, they leave in order, so that those with a digit are written side by side.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_ballot : require
#endif
#include "frame.glsl"
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

#if STGS_BALLOT
layout(constant_id = 0) const uint kLanes = 32u;  // of a subgroup: 16 or 32
#else
const uint kLanes = 32u;  // bits of a word
#endif
const uint kWords = kGroup / kLanes;
const uint kEach = kSortTile / kGroup;  // keys of an invocation

// Of the keys that are ranked at once, a bit each where it has the digit.
shared uint having[kDigits * kWords];
shared uint places[kDigits];  // of the next key with the digit
#if STGS_BALLOT
// Keys, then values, in the order in which they leave: those with a digit side by side.
shared uint stage[kSortTile];
shared uint offsets[kDigits];  // of a digit's keys, from there to where they go
#endif

#if STGS_BALLOT
uint thread_number() {
  return gl_SubgroupID * kLanes + gl_SubgroupInvocationID;
}
// The word of a digit: all lanes that have it write the same.
void tell(uint digit, bool there, uint thread) {
  uint same = subgroupBallot(there).x;
  for (uint bit = 0u; bit < 8u; ++bit) {
    bool set = (digit >> bit & 1u) != 0u;
    uint ones = subgroupBallot(set).x;
    same &= set ? ones : ~ones;
  }
  if (there) having[digit * kWords + thread / kLanes] = same;
}
#else
uint thread_number() {
  return gl_LocalInvocationIndex;
}
void tell(uint digit, bool there, uint thread) {
  if (there) atomicOr(having[digit * kWords + thread / kLanes], 1u << (thread % kLanes));
}
#endif

#if STGS_BALLOT
// Where the keys with a digit begin among the workgroup's own.
uint first_place(uint digit, uint group, uint groups) {
  uint at = digit * groups + group, total;
  uint next = group + 1u < groups ? digit_places[at + 1u] : digit_sums[digit];
  return sum_before(digit, next - digit_places[at], total);
}

void write_sorted(uint first, uint n, uint thread, uint own_keys[kEach], uint own_values[kEach],
                  uint own_places[kEach]) {
  uint to[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    if (first + k * kGroup + thread < n) stage[own_places[k]] = own_keys[k];
  }
  barrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint place = k * kGroup + thread;
    if (first + place >= n) continue;
    uint key = stage[place];
    to[k] = offsets[key >> push.shift & (kDigits - 1u)] + place;
    keys_out[to[k]] = key;
  }
  barrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    if (first + k * kGroup + thread < n) stage[own_places[k]] = own_values[k];
  }
  barrier();
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint place = k * kGroup + thread;
    if (first + place < n) values_out[to[k]] = stage[place];
  }
}
#endif

void main() {
  uint n = work[push.work].w, group = group_number(), thread = thread_number();
  uint first = group * kSortTile;
  if (first >= n) return;
  uint groups = (n + kSortTile - 1u) / kSortTile;
  uint total;
  uint begin =
      digit_places[thread * groups + group] + sum_before(thread, digit_sums[thread], total);
#if STGS_BALLOT
  uint place_here = first_place(thread, group, groups);
  places[thread] = place_here;
  offsets[thread] = begin - place_here;
#else
  places[thread] = begin;
#endif
  for (uint k = 0u; k < kWords; ++k) having[thread * kWords + k] = 0u;
  barrier();
  // All are asked for at once: what is waited for is memory.
  uint own_keys[kEach], own_values[kEach], own_places[kEach];
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    uint i = first + k * kGroup + thread;
    own_keys[k] = i < n ? keys[i] : 0u;
    own_values[k] = i < n ? values[i] : 0u;
  }
  [[unroll]] for (uint k = 0u; k < kEach; ++k) {
    bool there = first + k * kGroup + thread < n;
    uint digit = own_keys[k] >> push.shift & (kDigits - 1u);
    tell(digit, there, thread);
    barrier();
    if (there) {
      uint word = thread / kLanes;
      uint to = places[digit];
      for (uint w = 0u; w < word; ++w) to += uint(bitCount(having[digit * kWords + w]));
      to += uint(bitCount(having[digit * kWords + word] & ((1u << (thread % kLanes)) - 1u)));
      own_places[k] = to;
#if !STGS_BALLOT
      keys_out[to] = own_keys[k];
      values_out[to] = own_values[k];
#endif
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
#if STGS_BALLOT
  write_sorted(first, n, thread, own_keys, own_values, own_places);
#endif
}
