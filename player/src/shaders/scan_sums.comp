// SPDX-License-Identifier: Apache-2.0
// One workgroup: replaces the totals of scan_items by the sums before them, and plans the work that
// depends on the total of all.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#endif
#include "frame.glsl"
#include "scan.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 1) buffer SumBuffer {
  uint sums[];
};

uvec4 work_for(uint items, uint each) {
  uint groups = (items + each - 1u) / each;
  return uvec4(min(groups, kGroupsX), (groups + kGroupsX - 1u) / kGroupsX, 1u, items);
}

void plan_visible(uint count) {
  visible = count;
  work[kWorkSortDepth] = work_for(count, kSortTile);
  work[kWorkCountTiles] = work_for(count, kGroup);
  work[kWorkScanTiles] = work_for((count + kGroup - 1u) / kGroup, kScanTile);
}

void plan_instances(uint count) {
  uint fitting = min(count, frame.instance_capacity);
  instances = count;
  listed = fitting;
  work[kWorkListTiles] = work_for(fitting > 0u ? visible : 0u, kGroup);
  work[kWorkSortTiles] = work_for(fitting, kSortTile);
  work[kWorkFindRanges] = work_for(fitting, kGroup);
}

void main() {
  uint thread = thread_number();
  uint n = (work[push.work].w + kScanTile - 1u) / kScanTile;
  uint all = 0u;
  for (uint first = 0u; first < n; first += kGroup) {
    uint i = first + thread;
    uint total;
    uint before = sum_before(thread, i < n ? sums[i] : 0u, total);
    if (i < n) sums[i] = added(all, before);
    all = added(all, total);
  }
  if (thread != 0u) return;
  if (push.total == kTotalVisible) plan_visible(all);
  if (push.total == kTotalInstances) plan_instances(all);
}
