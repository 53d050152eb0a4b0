// SPDX-License-Identifier: Apache-2.0
// Nearest rows on every vector target, against a search through all pairs.
#include "geometry/nearest_rows.h"

#include "catch.h"
#include "train/random.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::geometry;
using namespace stgs::testing;

namespace {

constexpr int kColumns = 12;

// Few values, so that distances are often equal.
std::vector<float> random_rows(int count, std::uint64_t seed) {
  Random random(seed, 0, RandomPurpose::kStereo);
  std::vector<float> values(static_cast<std::size_t>(count) * kColumns);
  for (float& value : values) value = static_cast<float>(random.below(4));
  return values;
}

Rows rows_of(const std::vector<float>& values) {
  return {values.data(), static_cast<int>(values.size()) / kColumns, kColumns};
}

NearestRow nearest(const float* row, const Rows& others) {
  NearestRow out;
  for (int j = 0; j < others.count; ++j) {
    float squared = 0;
    for (int c = 0; c < kColumns; ++c) {
      const float difference = row[c] - others.values[j * kColumns + c];
      squared += difference * difference;
    }
    if (squared < out.first) {
      out.second = out.first;
      out.first = squared;
      out.index = j;
    } else if (squared < out.second) {
      out.second = squared;
    }
  }
  return out;
}

void check_equal(const std::vector<NearestRow>& found, const Rows& rows, const Rows& others) {
  REQUIRE(found.size() == static_cast<std::size_t>(rows.count));
  for (int i = 0; i < rows.count; ++i) {
    const NearestRow expected = nearest(rows.values + i * kColumns, others);
    CHECK(found[static_cast<std::size_t>(i)].index == expected.index);
    CHECK(found[static_cast<std::size_t>(i)].first == expected.first);
    CHECK(found[static_cast<std::size_t>(i)].second == expected.second);
  }
}

}  // namespace

TEST_CASE("the nearest row and the second are those of a search through all pairs") {
  for (const auto& [rows, others] : {std::pair{37, 50}, std::pair{1, 2}, std::pair{5, 1}}) {
    const std::vector<float> a = random_rows(rows, 1), b = random_rows(others, 2);
    for_each_vector_target([&] {
      const NearestRows found = find_nearest_rows(rows_of(a), rows_of(b));
      check_equal(found.to_b, rows_of(a), rows_of(b));
      check_equal(found.to_a, rows_of(b), rows_of(a));
    });
  }
}
