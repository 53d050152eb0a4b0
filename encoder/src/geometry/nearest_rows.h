// SPDX-License-Identifier: Apache-2.0
// The nearest rows between two matrices: matches of descriptors.
#pragma once

#include <vector>

namespace stgs::encoder::geometry {

// Squared distances of a row to its nearest row of the other matrix and to the second; of equal
// ones, the row of the lowest index is the nearest.
struct NearestRow {
  int index = -1;
  float first = 1e30f, second = 1e30f;
};

// Row-major values. Distances are exact if all sums of squares are integers below 2^24.
struct Rows {
  const float* values;
  int count, columns;
};

struct NearestRows {
  std::vector<NearestRow> to_b, to_a;  // of each row of a, and of b
};

// Compares all rows of `a` with all of `b`, which has as many columns.
NearestRows find_nearest_rows(const Rows& a, const Rows& b);

}  // namespace stgs::encoder::geometry
