// SPDX-License-Identifier: Apache-2.0
// The rows of tiles that a workgroup's splats have, which its invocations share among them: the
// nearest splats are next to each other, and have many times the rows of others. After frame.glsl,
// footprint.glsl, fovea.glsl and scan.glsl, on which it builds.

layout(std430, set = 1, binding = 1) readonly buffer OrderBuffer {
  uint order[];
};

shared uint row_splats[kGroup];
shared uint row_begins[kGroup];  // of a splat, among the workgroup's rows

// What is met in the two lines of squares of a size that a row has: the first, and how many.
struct Cells {
  ivec2 upper, lower;
};

// What a row lists.
struct RowTiles {
  uint place;  // of its splat in the workgroup
  Footprint f;
  int row;
  Cells met;           // of its tiles the quarters; of its squares the tiles
  ivec2 upper, lower;  // tiles, one after the other; of one line, or two where there are squares
  ivec2 left, right;   // squares at half resolution to either side of them
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

Cells cells_of(Footprint f, int row, int pixels) {
  return Cells(span_of(f, 2 * row, pixels), span_of(f, 2 * row + 1, pixels));
}

// The tiles that have a quarter that is met; the squares that have such a tile.
ivec2 wholes_of(Cells cells) {
  ivec2 a = cells.upper.y > 0 ? cells.upper : cells.lower;
  ivec2 b = cells.lower.y > 0 ? cells.lower : a;
  int first = min(a.x, b.x) / 2, end = (max(a.x + a.y, b.x + b.y) + 1) / 2;
  return ivec2(first, a.y > 0 ? end - first : 0);
}

bool has(ivec2 span, int i) {
  return i >= span.x && i < span.x + span.y;
}

// Which of the four of one of them are met: bit x + 2 y.
uint met_of(Cells cells, int whole) {
  int left = 2 * whole, right = left + 1;
  return (has(cells.upper, left) ? 1u : 0u) | (has(cells.upper, right) ? 2u : 0u) |
         (has(cells.lower, left) ? 4u : 0u) | (has(cells.lower, right) ? 8u : 0u);
}

// Those of the span from `first` to before `end`.
ivec2 between(ivec2 span, int first, int end) {
  first = max(first, span.x);
  return ivec2(first, max(min(end, span.x + span.y) - first, 0));
}

RowTiles tiles_of_row(uint row) {
  // The last of the splats that begin up to it.
  uint place = 0u;
  for (uint step = kGroup / 2u; step > 0u; step /= 2u) {
    if (row_begins[place + step] <= row) place += step;
  }
  RowTiles found;
  found.place = place;
  found.f = footprint_of(row_splats[place]);
  found.row = found.f.row + int(row - row_begins[place]);
  found.met = cells_of(found.f, found.row, kFovea ? kTilePixels : kQuarterPixels);
  ivec2 wholes = wholes_of(found.met), none = ivec2(0);
  if (!kFovea) {
    found.upper = wholes;
    found.lower = found.left = found.right = none;
    return found;
  }
  ivec2 sharp = sharp_squares(found.f.view, found.row);
  int begin = sharp.x, end = sharp.x + sharp.y, last = wholes.x + wholes.y;
  found.upper = between(found.met.upper, 2 * begin, 2 * end);
  found.lower = between(found.met.lower, 2 * begin, 2 * end);
  found.left = between(wholes, 0, sharp.y > 0 ? begin : last);
  found.right = sharp.y > 0 ? between(wholes, end, last) : none;
  return found;
}

uint count_of(RowTiles row) {
  return uint(row.upper.y + row.lower.y + row.left.y + row.right.y);
}
