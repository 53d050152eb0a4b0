// SPDX-License-Identifier: Apache-2.0
// Parsing of JSON files, and their error texts.
#pragma once

#include <exception>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "stgs/format/json_text.h"

namespace stgs::encoder {

// Returns the text of an exception thrown while reading JSON, for use after a file name:
// "not valid JSON at line 3, column 9: unexpected ']'", "\"K\" is missing". The JSON library's
// "[json.exception...]" prefix is removed; other exceptions are returned unchanged.
std::string json_error(const std::exception& error);

// Parses JSON of at most kMaxJsonNesting levels. kInvalidFile begins with `where`. Text of others
// is not parsed to ordered_json, which takes time quadratic in the keys of an object.
Result<nlohmann::json> parse_json_text(std::string_view text, const std::string& where);

}  // namespace stgs::encoder
