// SPDX-License-Identifier: Apache-2.0
#define CATCH_CONFIG_RUNNER
#include "catch_runner.h"

#include "catch.h"

#ifdef __SANITIZE_ADDRESS__
// Keeps libraries loaded until the leaks are reported: memory that the global variables of an
// unloaded Vulkan driver own counts as leaked.
extern "C" int dlclose(void*) {
  return 0;
}
#endif

namespace stgs::testing {

int run_cases(int argc, char** argv) {
  return Catch::Session().run(argc, argv);
}

}  // namespace stgs::testing
