// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace stgs {

// Returns whether the bytes are UTF-8 (RFC 3629): no overlong forms, no surrogates, nothing above
// U+10FFFF.
bool is_utf8(std::string_view text);

// Returns the text of an errno value of opening or creating a file, with advice: "Permission
// denied; check the permissions".
std::string file_problem(int error);

}  // namespace stgs
