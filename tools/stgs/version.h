// SPDX-License-Identifier: Apache-2.0
// The version of the program, its backends and its built-in features.
#pragma once

#include <string>

#include "session.h"

namespace stgs::tools {

Json version_json();
// Returns the same as lines of text.
std::string version_text();

}  // namespace stgs::tools
