// SPDX-License-Identifier: Apache-2.0
#define CATCH_CONFIG_RUNNER
#include "catch_runner.h"

#include "catch.h"

namespace stgs::testing {

int run_cases(int argc, char** argv) {
  return Catch::Session().run(argc, argv);
}

}  // namespace stgs::testing
