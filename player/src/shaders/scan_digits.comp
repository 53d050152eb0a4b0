// SPDX-License-Identifier: Apache-2.0
// A workgroup a digit: replaces its numbers of keys in the sort's workgroups by the sums before
// them, and tells how many keys have it in all.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#endif
#include "frame.glsl"
#include "scan.glsl"

layout(local_size_x = 256) in;

void main() {
  uint thread = thread_number(), digit = gl_WorkGroupID.x;
  uint groups = (work[push.work].w + kSortTile - 1u) / kSortTile;
  uint all = 0u;
  for (uint first = 0u; first < groups; first += kGroup) {
    uint group = first + thread, total;
    uint at = digit * groups + group;
    uint before = sum_before(thread, group < groups ? digit_places[at] : 0u, total);
    if (group < groups) digit_places[at] = all + before;
    all += total;
  }
  if (thread == 0u) digit_sums[digit] = all;
}
