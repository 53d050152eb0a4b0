// SPDX-License-Identifier: Apache-2.0
// Replaces the splat counts of chunks with their exclusive prefix sums, kScanTile at a time. The
// last workgroup scans the totals and computes the extents of the dispatches over visible splats.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#endif
#include "frame.glsl"

// Require frame.glsl.
#include "last.glsl"
#include "scan.glsl"

layout(local_size_x = 256) in;

void scan_sums(uint n, uint thread) {
  uint all = 0u;
  for (uint first = 0u; first < n; first += kGroup) {
    uint i = first + thread, total;
    uint before = sum_before(thread, i < n ? chunk_sums[i] : 0u, total);
    if (i < n) chunk_sums[i] = added(all, before);
    all = added(all, total);
  }
  if (thread != 0u) return;
  visible = all;
  work[kWorkSortDepth] = work_for(all, kSortTile);
  work[kWorkCountTiles] = work_for(list_groups(all), 1u);
}

void main() {
  uint n = frame.views * frame.chunks, groups = (n + kScanTile - 1u) / kScanTile;
  uint group = group_number(), thread = thread_number();
  if (group >= groups) return;
  uint first = group * kScanTile + thread * kScanEach;
  uint values[kScanEach];
  [[unroll]] for (uint k = 0u; k < kScanEach; ++k) {
    values[k] = first + k < n ? chunk_offsets[first + k] : 0u;
  }
  uint total = scan_tile(thread, values);
  [[unroll]] for (uint k = 0u; k < kScanEach; ++k) {
    if (first + k < n) chunk_offsets[first + k] = values[k];
  }
  if (thread == 0u) chunk_sums[group] = total;
  if (is_last(kEndedScanChunks, groups, thread)) scan_sums(groups, thread);
}
