// SPDX-License-Identifier: Apache-2.0
// The program: from the command line to a verb, and from the verb's status to the exit code.
#pragma once

namespace stgs::tools {

// Runs the program and returns its exit code. All messages have been printed.
int run_program(int argc, char** argv);

}  // namespace stgs::tools
