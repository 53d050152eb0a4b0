// SPDX-License-Identifier: Apache-2.0
// Error texts for JSON files.
#pragma once

#include <exception>
#include <string>

namespace stgs::encoder {

// Returns the text of an exception thrown while reading JSON, for use after a file name:
// "not valid JSON at line 3, column 9: unexpected ']'", "\"K\" is missing". The JSON library's
// "[json.exception...]" prefix is removed; other exceptions are returned unchanged.
std::string json_error(const std::exception& error);

}  // namespace stgs::encoder
