// SPDX-License-Identifier: Apache-2.0
// format/math on a CUDA device against C++. Exit code 77: there is no device.
#include <cstdio>

#include "catch.h"
#include "catch_runner.h"
#include "math_parity_check.h"
#include "math_parity_cuda.h"

using namespace stgs::test;

TEST_CASE("CUDA computes what C++ computes") {
  const auto given = parity_primitives(10000, 1);
  std::vector<stgs::math::ParityFound> found;
  REQUIRE(parity_on_cuda(given, &found) == "");
  const std::vector<ParityRow> rows = compare_parity(given, found);
  std::printf("CUDA against C++, %zu primitives\n%s", given.size(), parity_table(rows).c_str());
  for (const ParityRow& row : rows) {
    INFO(row.quantity << ", primitive " << row.worst_index);
    CHECK(row.worst <= 1.0);
  }
}

int main(int argc, char** argv) {
  const std::string missing = cuda_missing();
  if (!missing.empty()) {
    std::printf("skipped: %s\n", missing.c_str());
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
