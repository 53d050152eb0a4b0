// SPDX-License-Identifier: Apache-2.0
// Compares format/math on a CUDA device with C++. Exit code 77: no device found.
#include <cstdio>

#include "catch.h"
#include "catch_runner.h"
#include "math_parity_check.h"
#include "math_parity_cuda.h"

using namespace stgs::test;

TEST_CASE("format/math on CUDA matches C++ within the specified tolerances") {
  const auto inputs = random_parity_inputs(10000, 1);
  std::vector<stgs::math::ParityResult> results;
  REQUIRE(evaluate_on_cuda(inputs, &results) == "");
  const std::vector<ParityRow> rows = compare_parity(inputs, results);
  std::printf("CUDA against C++, %zu primitives\n%s", inputs.size(), parity_table(rows).c_str());
  for (const ParityRow& row : rows) {
    INFO(row.quantity << ", primitive " << row.worst_index);
    CHECK(row.worst <= 1.0);
  }
}

int main(int argc, char** argv) {
  const std::string reason = cuda_unavailable_reason();
  if (!reason.empty()) {
    std::printf("skipped: %s\n", reason.c_str());
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
