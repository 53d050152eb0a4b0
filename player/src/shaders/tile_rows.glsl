// SPDX-License-Identifier: Apache-2.0
// The rows of tiles that a workgroup's splats have, which its invocations share among them: the
// nearest splats are next to each other, and have many times the rows of others. After frame.glsl,
// footprint.glsl and scan.glsl, on which it builds.

layout(std430, set = 1, binding = 1) readonly buffer OrderBuffer {
  uint order[];
};

shared uint row_splats[kGroup];
shared uint row_begins[kGroup];  // of a splat, among the workgroup's rows

// The tiles of a row of them.
struct RowTiles {
  uint place;          // of its splat in the workgroup
  uint first, count;   // of the frame's tiles
  int column;          // of the first in its view
  ivec2 upper, lower;  // first and count of the quarters met in either half of the row
};

// Brings the workgroup's splats and tells how many rows they have. All invocations call it.
uint load_rows(uint group, uint thread) {
  uint rows = 0u, all, rank = list_begin(group) + thread;
  if (rank < min(visible, list_begin(group + 1u))) {
    uint splat = order[rank];
    row_splats[thread] = splat;
    rows = uint(footprint_of(splat).rows);
  }
  row_begins[thread] = sum_before(thread, rows, all);
  barrier();
  return all;
}

RowTiles tiles_of_row(uint row) {
  // The last of the splats that begin up to it.
  uint place = 0u;
  for (uint step = kGroup / 2u; step > 0u; step /= 2u) {
    if (row_begins[place + step] <= row) place += step;
  }
  Footprint f = footprint_of(row_splats[place]);
  int line = f.row + int(row - row_begins[place]);
  ivec2 upper = span_of(f, 2 * line), lower = span_of(f, 2 * line + 1);
  ivec2 a = upper.y > 0 ? upper : lower, b = lower.y > 0 ? lower : a;
  int first = min(a.x, b.x) / 2, end = (max(a.x + a.y, b.x + b.y) + 1) / 2;
  return RowTiles(place, f.first_tile + uint(line * f.tiles_x + first),
                  uint(a.y > 0 ? end - first : 0), first, upper, lower);
}

bool has(ivec2 span, int quarter) {
  return quarter >= span.x && quarter < span.x + span.y;
}

// Which quarters of the row's k-th tile are met.
uint met_of(RowTiles row, uint k) {
  int left = 2 * (row.column + int(k)), right = left + 1;
  return (has(row.upper, left) ? 1u : 0u) | (has(row.upper, right) ? 2u : 0u) |
         (has(row.lower, left) ? 4u : 0u) | (has(row.lower, right) ? 8u : 0u);
}
