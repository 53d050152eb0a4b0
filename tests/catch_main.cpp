// SPDX-License-Identifier: Apache-2.0
// The main() of tests that need nothing before or after their cases.
#include "catch_runner.h"

int main(int argc, char** argv) {
  return stgs::testing::run_cases(argc, argv);
}
