// SPDX-License-Identifier: Apache-2.0
// Catch2 for tests whose main() is their own, compiled once: it takes a quarter of a minute.
#pragma once

namespace stgs::testing {

// Runs the program's cases as its arguments say; the exit code.
int run_cases(int argc, char** argv);

}  // namespace stgs::testing
