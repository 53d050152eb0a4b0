// SPDX-License-Identifier: Apache-2.0
// How many tiles the ellipses of each workgroup's splats meet; nearest first.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#endif
#include "frame.glsl"

// After frame.glsl, on which they build.
#include "footprint.glsl"
#include "scan.glsl"
#include "tile_rows.glsl"

layout(local_size_x = 256) in;

void main() {
  uint group = group_number(), thread = thread_number();
  if (group * kGroup >= visible) return;
  uint rows = load_rows(group * kGroup, thread), count = 0u, total;
  for (uint row = thread; row < rows; row += kGroup) count += tiles_of_row(row).count;
  sum_before(thread, min(count, kManyInstances), total);
  if (thread == 0u) tile_places[group] = total;
}
