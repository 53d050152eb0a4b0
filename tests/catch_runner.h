// SPDX-License-Identifier: Apache-2.0
// Catch2 for tests with their own main(), compiled once because it takes 15 s.
#pragma once

namespace stgs::testing {

// Runs the test cases that the arguments select; returns the exit code.
int run_cases(int argc, char** argv);

}  // namespace stgs::testing
