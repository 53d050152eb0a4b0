// SPDX-License-Identifier: Apache-2.0
// Replaces numbers by the sums before them, kScanTile at a time, whose totals it writes.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#endif
#include "frame.glsl"
#include "scan.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 0) buffer ItemBuffer {
  uint items[];
};
layout(std430, set = 1, binding = 1) writeonly buffer SumBuffer {
  uint sums[];
};

const uint kEach = kScanTile / kGroup;

void main() {
  uint n = work[push.work].w, group = group_number(), thread = thread_number();
  if (group * kScanTile >= n) return;
  uint first = group * kScanTile + thread * kEach;
  uint own[kEach];
  uint sum = 0u;
  for (uint k = 0u; k < kEach; ++k) {
    uint item = first + k < n ? items[first + k] : 0u;
    own[k] = sum;
    sum = added(sum, min(item, kManyInstances));
  }
  uint total;
  uint before = sum_before(thread, sum, total);
  for (uint k = 0u; k < kEach; ++k) {
    if (first + k < n) items[first + k] = added(before, own[k]);
  }
  if (thread == 0u) sums[group] = total;
}
