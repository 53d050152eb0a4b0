// SPDX-License-Identifier: Apache-2.0
// Lists the instances: for each splat, nearest first, the tiles that its ellipse meets, or squares
// of 2 x 2 tiles at half resolution, and which of their quarters, so that the blend need not test
// them. The instances of a tile are thus in depth order, which the stable sort by tile preserves.
// If not all fit, the nearest are listed.
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

// The output range [begin_at, end_at) of the workgroup. Tiles beyond the number that was counted
// would be dropped.
uint begin_at, end_at;
bool staged;

void emit(uint to, uint tile, uint of, uint met) {
  if (to >= end_at) return;
  if (staged) {
    stage[to - begin_at] = tile << kStagedTileShift | met << kStagedMetShift | of;
  } else {
    write_instance(to, tile, row_splats[of], met);
  }
}

// Emits the tiles of a span, `each` tiles apart in a line. Returns the next output index.
uint emit_span(uint to, RowTiles row, ivec2 span, int line, int each, Cells met) {
  uint tile = row.f.first_tile + uint(line * row.f.tiles_x + span.x * each);
  for (int k = 0; k < span.y; ++k) {
    emit(to + uint(k), tile + uint(k * each), row.index, met_of(met, span.x + k));
  }
  return to + uint(span.y);
}

void emit_row(uint to, RowTiles row) {
  if (!kFovea) {
    emit_span(to, row, row.upper, row.row, 1, row.met);
    return;
  }
  int line = 2 * row.row;
  if (row.upper.y > 0) {
    to = emit_span(to, row, row.upper, line, 1, cells_of(row.f, line, kQuarterPixels));
  }
  if (row.lower.y > 0) {
    to = emit_span(to, row, row.lower, line + 1, 1, cells_of(row.f, line + 1, kQuarterPixels));
  }
  to = emit_span(to, row, row.left, line, 2, row.met);
  emit_span(to, row, row.right, line, 2, row.met);
}

void main() {
  uint thread = thread_number(), group = group_number();
  uint groups = list_groups(visible);
  if (group >= groups) return;
  begin_at = tile_offsets[group];
  end_at = group + 1u < groups ? tile_offsets[group + 1u] : instances;
  if (begin_at >= listed) return;
  // Differences of saturated sums are not valid counts.
  staged =
      end_at - begin_at <= kListStage && end_at < kManyInstances && frame.tiles <= kMaxStagedTiles;
  // If fewer were emitted than counted, the rest would have no quarters set and not be rendered.
  for (uint k = thread; staged && k < end_at - begin_at; k += kGroup) stage[k] = 0u;
  uint rows = load_rows(group, thread), begin = begin_at;
  for (uint row = thread; row - thread < rows; row += kGroup) {
    RowTiles own;
    uint count = 0u, total;
    if (row < rows) {
      own = tiles_of_row(row);
      count = count_of(own);
    }
    uint to = begin + sum_before(thread, count, total);
    if (count > 0u) emit_row(to, own);
    begin += total;
  }
  if (!staged) return;
  barrier();
  for (uint k = thread; k < end_at - begin_at; k += kGroup) {
    uint one = stage[k];
    uint splat = row_splats[one & kGroup - 1u],
         met = one >> kStagedMetShift & (1u << kQuarters) - 1u;
    write_instance(begin_at + k, one >> kStagedTileShift, splat, met);
  }
}
