// SPDX-License-Identifier: Apache-2.0
// Instances: for each splat, nearest first, the tiles that its ellipse meets, or squares of 2 x 2
// at half resolution, and which quarters of them, so that the blend need not look. Those of one
// tile are in the order of depth then, which the stable sort by tile keeps. The nearest are listed
// where not all fit.
#version 450
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#if STGS_BALLOT
#extension GL_KHR_shader_subgroup_shuffle_relative : require
#endif
#include "frame.glsl"

// After frame.glsl, on which they build.
#include "footprint.glsl"
#include "fovea.glsl"
#include "scan.glsl"
#include "tile_rows.glsl"

layout(local_size_x = 256) in;
layout(std430, set = 1, binding = 2) writeonly buffer KeyBuffer {
  uint keys[];
};
layout(std430, set = 1, binding = 3) writeonly buffer ValueBuffer {
  uint values[];
};

shared uint stage[kListStage];

void write_instance(uint to, uint tile, uint splat, uint met) {
  if (to >= listed) return;
  keys[to] = tile;
  values[to] = splat | met << kSplatBits;
}

// Where the workgroup's instances go: from `first_place` to before `end_place`, where the next
// one's are. Were more tiles found than were counted, they would be left out.
uint first_place, end_place;
bool staged;

void put(uint to, uint tile, uint of, uint met) {
  if (to >= end_place) return;
  if (staged) {
    stage[to - first_place] = tile << kStagedTileShift | met << kStagedMetShift | of;
  } else {
    write_instance(to, tile, row_splats[of], met);
  }
}

// Those of the span, `each` tiles apart in a line of them; returns the place after them.
uint put_span(uint to, RowTiles row, ivec2 span, int line, int each, Cells met) {
  uint tile = row.f.first_tile + uint(line * row.f.tiles_x + span.x * each);
  for (int k = 0; k < span.y; ++k) {
    put(to + uint(k), tile + uint(k * each), row.place, met_of(met, span.x + k));
  }
  return to + uint(span.y);
}

void put_row(uint to, RowTiles row) {
  if (!kFovea) {
    put_span(to, row, row.upper, row.row, 1, row.met);
    return;
  }
  int line = 2 * row.row;
  if (row.upper.y > 0) {
    to = put_span(to, row, row.upper, line, 1, cells_of(row.f, line, kQuarterPixels));
  }
  if (row.lower.y > 0) {
    to = put_span(to, row, row.lower, line + 1, 1, cells_of(row.f, line + 1, kQuarterPixels));
  }
  to = put_span(to, row, row.left, line, 2, row.met);
  put_span(to, row, row.right, line, 2, row.met);
}

void main() {
  uint thread = thread_number(), group = group_number();
  uint groups = list_groups(visible);
  if (group >= groups) return;
  first_place = tile_places[group];
  end_place = group + 1u < groups ? tile_places[group + 1u] : instances;
  if (first_place >= listed) return;
  // Sums that stopped at the most that is counted say nothing of what lies between them.
  staged = end_place - first_place <= kListStage && end_place < kManyInstances &&
           frame.tiles <= kMostStagedTiles;
  // Were fewer found, the rest would stand in a tile that they do not meet, where they are not
  // drawn.
  for (uint k = thread; staged && k < end_place - first_place; k += kGroup) stage[k] = 0u;
  uint rows = load_rows(group, thread), begin = first_place;
  for (uint row = thread; row - thread < rows; row += kGroup) {
    RowTiles own;
    uint count = 0u, total;
    if (row < rows) {
      own = tiles_of_row(row);
      count = count_of(own);
    }
    uint to = begin + sum_before(thread, count, total);
    if (count > 0u) put_row(to, own);
    begin += total;
  }
  if (!staged) return;
  barrier();
  for (uint k = thread; k < end_place - first_place; k += kGroup) {
    uint one = stage[k];
    uint splat = row_splats[one & kGroup - 1u],
         met = one >> kStagedMetShift & (1u << kQuarters) - 1u;
    write_instance(first_place + k, one >> kStagedTileShift, splat, met);
  }
}
