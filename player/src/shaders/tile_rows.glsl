// SPDX-License-Identifier: Apache-2.0
// The rows of tiles that a workgroup's splats have, which its invocations share among them: the
// nearest splats are next to each other, and have many times the rows of others. After frame.glsl,
// footprint.glsl and scan.glsl, on which it builds.

layout(std430, set = 1, binding = 1) readonly buffer OrderBuffer {
  uint order[];
};

shared uint row_splats[kGroup];
shared uint row_begins[kGroup];  // of a splat, among the workgroup's rows

// The tiles of a row.
struct RowTiles {
  uint place;  // of its splat in the workgroup
  uint first, count;
};

// Brings the splats from the rank `first` on and tells how many rows they have. All invocations
// call it.
uint load_rows(uint first, uint thread) {
  uint rows = 0u, all;
  if (first + thread < visible) {
    uint splat = order[first + thread];
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
  ivec2 span = span_of(f, line);
  return RowTiles(place, f.first_tile + uint(line * f.tiles_x + span.x), uint(span.y));
}
