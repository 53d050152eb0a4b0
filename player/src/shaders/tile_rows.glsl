// SPDX-License-Identifier: Apache-2.0
// The rows of tiles of a workgroup's splats, distributed over its invocations: the nearest splats
// are adjacent and have many times more rows than others. Requires frame.glsl, footprint.glsl,
// fovea.glsl and scan.glsl.

layout(std430, set = 1, binding = 1) readonly buffer OrderBuffer {
  uint order[];
};

shared uint row_splats[kGroup];
shared uint row_begins[kGroup];  // first row of a splat, among the workgroup's rows

// The cells that are met in the upper and the lower half of a row: first and count.
struct Cells {
  ivec2 upper, lower;
};

// The instances of a row.
struct RowTiles {
  uint index;  // of the splat in the workgroup
  Footprint f;
  int row;
  Cells met;           // quarters of its tiles; with foveae, tiles of its squares
  ivec2 upper, lower;  // spans of tiles at full resolution; lower: with foveae only
  ivec2 left, right;   // spans of squares at half resolution on either side of them
};

// Loads the workgroup's splats and returns the number of their rows. All invocations must call it.
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

// Returns the span of tiles with a quarter that is met, or of squares with a tile that is met.
ivec2 tiles_of_cells(Cells cells) {
  ivec2 a = cells.upper.y > 0 ? cells.upper : cells.lower;
  ivec2 b = cells.lower.y > 0 ? cells.lower : a;
  int first = min(a.x, b.x) / 2, end = (max(a.x + a.y, b.x + b.y) + 1) / 2;
  return ivec2(first, a.y > 0 ? end - first : 0);
}

bool has(ivec2 span, int i) {
  return i >= span.x && i < span.x + span.y;
}

// Returns which of the four cells of a tile or square are met: bit x + 2 y.
uint met_of(Cells cells, int tile) {
  int left = 2 * tile, right = left + 1;
  return (has(cells.upper, left) ? 1u : 0u) | (has(cells.upper, right) ? 2u : 0u) |
         (has(cells.lower, left) ? 4u : 0u) | (has(cells.lower, right) ? 8u : 0u);
}

// Intersects a span with [first, end).
ivec2 between(ivec2 span, int first, int end) {
  first = max(first, span.x);
  return ivec2(first, max(min(end, span.x + span.y) - first, 0));
}

RowTiles tiles_of_row(uint row) {
  // Find the last splat that begins at or before the row.
  uint index = 0u;
  for (uint step = kGroup / 2u; step > 0u; step /= 2u) {
    if (row_begins[index + step] <= row) index += step;
  }
  RowTiles found;
  found.index = index;
  found.f = footprint_of(row_splats[index]);
  found.row = found.f.row + int(row - row_begins[index]);
  found.met = cells_of(found.f, found.row, kFovea ? kTilePixels : kQuarterPixels);
  ivec2 tiles = tiles_of_cells(found.met), none = ivec2(0);
  if (!kFovea) {
    found.upper = tiles;
    found.lower = found.left = found.right = none;
    return found;
  }
  ivec2 sharp = sharp_squares(found.f.view, found.row);
  int begin = sharp.x, end = sharp.x + sharp.y, last = tiles.x + tiles.y;
  found.upper = between(found.met.upper, 2 * begin, 2 * end);
  found.lower = between(found.met.lower, 2 * begin, 2 * end);
  found.left = between(tiles, 0, sharp.y > 0 ? begin : last);
  found.right = sharp.y > 0 ? between(tiles, end, last) : none;
  return found;
}

uint count_of(RowTiles row) {
  return uint(row.upper.y + row.lower.y + row.left.y + row.right.y);
}
