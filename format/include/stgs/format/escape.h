// SPDX-License-Identifier: Apache-2.0
// Text within HTML and URLs.
#pragma once

#include <string>
#include <string_view>

namespace stgs {

// Returns text for elements and quoted attributes of HTML: & < > " as entities.
std::string escape_html(std::string_view text);

// Returns text for a URL: letters, digits and the characters of `plain` stay, all other bytes
// become %XX.
std::string escape_url(std::string_view text, std::string_view plain);

}  // namespace stgs
