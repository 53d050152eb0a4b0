// SPDX-License-Identifier: Apache-2.0
// Modules of the program: parts in shared libraries of their own, so that a run loads the libraries
// below a part only if it uses the part.
#pragma once

#include <string>

#include "stgs/format/status.h"

namespace stgs::encoder {

// Loads the module of that file name, from the folder of the program (in a build) or the module
// folder (of an installation), and returns the address of its `symbol`. The module stays loaded.
// `everyone`: its symbols serve libraries that are loaded later. kUnsupported if the module cannot
// be loaded or is of another version of stgs. Thread-safe.
Result<void*> load_program_module(const std::string& file, const char* symbol, bool everyone);

}  // namespace stgs::encoder
