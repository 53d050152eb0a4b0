// SPDX-License-Identifier: Apache-2.0
// format/math through GLSL on every Vulkan device against C++. Exit code 77: there is no device.
#include <cstdio>

#include "catch.h"
#include "catch_runner.h"
#include "math_parity_check.h"
#include "vulkan_compute.h"

using namespace stgs::test;
using stgs::math::ParityFound;
using stgs::math::ParityGiven;

namespace {

constexpr std::uint32_t kSpirv[] = {
#include "math_parity.spv.inc"
};
constexpr std::size_t kPrimitives = 10000;
constexpr std::uint32_t kGroupSize = 64;
constexpr int kSkipped = 77;

VulkanCompute* vulkan = nullptr;

}  // namespace

TEST_CASE("GLSL computes what C++ computes, and the validation layers have nothing to say") {
  const std::vector<ParityGiven> given = parity_primitives(kPrimitives, 1);
  for (std::size_t device = 0; device < vulkan->devices().size(); ++device) {
    INFO("device: " << vulkan->devices()[device]);
    std::vector<ParityFound> found(given.size());
    REQUIRE(vulkan->run(device, kSpirv, std::as_bytes(std::span(given)),
                        std::as_writable_bytes(std::span(found)),
                        (kPrimitives + kGroupSize - 1) / kGroupSize) == "");
    const std::vector<ParityRow> rows = compare_parity(given, found);
    std::printf("GLSL on %s against C++, %zu primitives\n%s", vulkan->devices()[device].c_str(),
                kPrimitives, parity_table(rows).c_str());
    for (const ParityRow& row : rows) {
      INFO(row.quantity << ", primitive " << row.worst_index);
      CHECK(row.worst <= 1.0);
    }
  }
  if (!vulkan->validated()) std::printf("validation layers not found: run without them\n");
  for (const std::string& message : vulkan->messages()) FAIL_CHECK(message);
}

TEST_CASE("the comparison fails where a value is off") {
  const std::vector<ParityGiven> given = parity_primitives(200, 2);
  std::vector<ParityFound> found;
  for (const ParityGiven& g : given) found.push_back(parity_of(g));
  for (const ParityRow& row : compare_parity(given, found)) CHECK(row.worst == 0.0);
  found[7].modulation *= 1.00001f;
  found[8].colour.y += 0.5f;
  found[9].visibility = NAN;
  std::string off;
  for (const ParityRow& row : compare_parity(given, found))
    off += row.worst > 1.0 ? row.quantity + "; " : "";
  CHECK(off == "modulation f; visibility l(t); colour; ");
}

int main(int argc, char** argv) {
  VulkanCompute compute;
  if (!compute.missing().empty()) {
    std::printf("skipped: %s\n", compute.missing().c_str());
    return kSkipped;
  }
  vulkan = &compute;
  return stgs::testing::run_cases(argc, argv);
}
