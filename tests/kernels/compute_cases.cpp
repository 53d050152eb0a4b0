// SPDX-License-Identifier: Apache-2.0
#include "compute_cases.h"

#include <cstdio>

#include "catch_runner.h"

namespace stgs::testing {
namespace {

test::VulkanCompute* shared_compute = nullptr;

}  // namespace

test::VulkanCompute& compute() {
  return *shared_compute;
}

int run_compute_cases(int argc, char** argv) {
  test::VulkanCompute made;
  if (!made.missing().empty()) {
    std::printf("skipped: %s\n", made.missing().c_str());
    return 77;
  }
  shared_compute = &made;
  const int failed = run_cases(argc, argv);
  if (!made.validated()) std::printf("Vulkan validation layers not found; running without them\n");
  for (const std::string& message : made.messages()) std::printf("%s\n", message.c_str());
  return failed != 0 ? failed : static_cast<int>(!made.messages().empty());
}

}  // namespace stgs::testing
