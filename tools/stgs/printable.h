// SPDX-License-Identifier: Apache-2.0
// Escapes untrusted text for terminals.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace stgs::tools {

// Hides userinfo and queries of everything that looks like a URL, of any scheme, well-formed or
// not.
std::string without_secrets(std::string_view text);
// As above, and hides those of URLs on the command line that `text` quotes, which may contain
// blanks.
std::string without_secrets(std::string_view text, const std::vector<std::string>& arguments);
// Escapes control characters (C0, DEL, C1), except line feeds and tabs, and bytes that are not
// UTF-8 as \\xNN, and controls of the direction of text as \\uNNNN.
std::string printable(std::string_view text);
// As printable(), but also escapes line feeds and tabs, for text within a line.
std::string one_line(std::string_view text);

}  // namespace stgs::tools
