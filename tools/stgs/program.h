// SPDX-License-Identifier: Apache-2.0
// From the command line to a verb's run, and from its status to the exit code.
#pragma once

#include <string>

#include "stgs/format/status.h"

namespace stgs::tools {

// The exit code; every message has been printed.
int run_program(int argc, char** argv);

// Program, format version, vector target, backends and what is built in.
std::string version_text();

}  // namespace stgs::tools
