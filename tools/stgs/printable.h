// SPDX-License-Identifier: Apache-2.0
// Text of foreign files, made harmless for a terminal.
#pragma once

#include <string>
#include <string_view>

namespace stgs::tools {

// With control characters (C0, DEL, and C1 in UTF-8) as \\xNN, but for line feeds and tabs.
std::string printable(std::string_view text);
// The same, line feeds and tabs too: for a text that stands within a line.
std::string one_line(std::string_view text);

}  // namespace stgs::tools
