// SPDX-License-Identifier: Apache-2.0
// Counts the tiles that the ellipses of each workgroup's splats meet, nearest first. The last
// workgroup replaces the counts with their exclusive prefix sums and computes the extents of the
// instance dispatches.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#endif
#include "frame.glsl"

// Require frame.glsl.
#include "footprint.glsl"
#include "fovea.glsl"
#include "last.glsl"
#include "scan.glsl"
#include "tile_rows.glsl"

layout(local_size_x = 256) in;

void scan_offsets(uint n, uint thread) {
  uint all = 0u;
  for (uint tile = 0u; tile < n; tile += kScanTile) {
    uint first = tile + thread * kScanEach;
    uint values[kScanEach];
    [[unroll]] for (uint k = 0u; k < kScanEach; ++k) {
      values[k] = first + k < n ? tile_offsets[first + k] : 0u;
    }
    uint total = scan_tile(thread, values);
    [[unroll]] for (uint k = 0u; k < kScanEach; ++k) {
      if (first + k < n) tile_offsets[first + k] = added(all, values[k]);
    }
    all = added(all, total);
  }
  if (thread != 0u) return;
  uint fitting = min(all, frame.instance_capacity);
  instances = all;
  listed = fitting;
  work[kWorkListTiles] = work_for(fitting > 0u ? list_groups(visible) : 0u, 1u);
  work[kWorkSortTiles] = work_for(fitting, kSortTile);
  work[kWorkFindRanges] = work_for(fitting, kGroup);
}

void main() {
  uint group = group_number(), thread = thread_number();
  uint groups = list_groups(visible);
  if (group >= groups) return;
  uint rows = load_rows(group, thread), count = 0u, total;
  for (uint row = thread; row < rows; row += kGroup) count += count_of(tiles_of_row(row));
  sum_before(thread, min(count, kManyInstances), total);
  if (thread == 0u) tile_offsets[group] = total;
  if (is_last(kEndedCountTiles, groups, thread)) scan_offsets(groups, thread);
}
