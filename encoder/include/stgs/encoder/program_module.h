// SPDX-License-Identifier: Apache-2.0
// Modules of the program: shared libraries that are loaded on first use, together with the
// libraries that only they depend on.
#pragma once

#include <string>

#include "stgs/format/status.h"

namespace stgs::encoder {

// Loads the module with this file name and returns the address of its `symbol`. The module is next
// to the file that contains this function, the program or a library (in a build), or in the module
// folder (of an installation); no other folder is searched. The module stays loaded. `global`:
// libraries that are loaded later can use its symbols. kUnsupported if the module is missing,
// cannot be loaded, belongs to another version of stgs, or can be replaced by every user.
// Thread-safe.
Result<void*> load_program_module(const std::string& file, const char* symbol, bool global);

}  // namespace stgs::encoder
