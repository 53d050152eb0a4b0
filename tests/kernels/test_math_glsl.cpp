// SPDX-License-Identifier: Apache-2.0
// Compares format/math in GLSL, on every Vulkan device, with C++. Exit code 77: no device found.
#include <cstdio>

#include "catch.h"
#include "compute_cases.h"
#include "math_parity_check.h"

using namespace stgs::test;
using stgs::math::ParityInput;
using stgs::math::ParityResult;
using stgs::testing::compute;

namespace {

constexpr std::uint32_t kSpirv[] = {
#include "math_parity.spv.inc"
};
constexpr std::size_t kPrimitives = 10000;
constexpr std::uint32_t kGroupSize = 64;

}  // namespace

TEST_CASE("format/math in GLSL matches C++ within the specified tolerances") {
  const std::vector<ParityInput> inputs = random_parity_inputs(kPrimitives, 1);
  for (std::size_t device = 0; device < compute().devices().size(); ++device) {
    INFO("device: " << compute().devices()[device]);
    std::vector<ParityResult> results(inputs.size());
    const ComputeBuffer buffers[] = {{std::as_bytes(std::span(inputs)), {}},
                                     {{}, std::as_writable_bytes(std::span(results))}};
    REQUIRE(compute().run(device, kSpirv, buffers, (kPrimitives + kGroupSize - 1) / kGroupSize) ==
            "");
    const std::vector<ParityRow> rows = compare_parity(inputs, results);
    std::printf("GLSL on %s against C++, %zu primitives\n%s", compute().devices()[device].c_str(),
                kPrimitives, parity_table(rows).c_str());
    for (const ParityRow& row : rows) {
      INFO(row.quantity << ", primitive " << row.worst_index);
      CHECK(row.worst <= 1.0);
    }
  }
}

TEST_CASE("the parity comparison names every quantity that differs") {
  const std::vector<ParityInput> inputs = random_parity_inputs(200, 2);
  std::vector<ParityResult> results;
  for (const ParityInput& g : inputs) results.push_back(evaluate_parity(g));
  for (const ParityRow& row : compare_parity(inputs, results)) CHECK(row.worst == 0.0);
  results[7].modulation *= 1.00001f;
  results[8].colour.y += 0.5f;
  results[9].visibility = NAN;
  std::string off;
  for (const ParityRow& row : compare_parity(inputs, results))
    off += row.worst > 1.0 ? row.quantity + "; " : "";
  CHECK(off == "modulation f; visibility l(t); colour; ");
}

int main(int argc, char** argv) {
  return stgs::testing::run_compute_cases(argc, argv);
}
