// SPDX-License-Identifier: Apache-2.0
// A limit on the nesting of files of OpenCV's FileStorage, whose parsers recurse.
#pragma once

#include <string>
#include <string_view>

#include "stgs/format/status.h"

namespace stgs::encoder {

// Greatest nesting of collections in brackets, or of XML elements.
inline constexpr int kMaxStorageNesting = 64;
// Greatest nesting of YAML collections by indentation: the column of a line, plus the ':' and '-'
// on it, each of which may begin a collection.
inline constexpr int kMaxStorageIndentation = 160;

// Returns kInvalidFile for YAML, JSON or XML that may nest deeper than the limits; `path` is for
// the message. Call it before OpenCV's parser. The nesting counted is never less than that of the
// parser: a closing bracket counts only where the parser cannot read it as part of a key, a text
// or a comment.
Status check_storage_nesting(std::string_view text, const std::string& path);

// Returns kInvalidFile for a text that crashes OpenCV 4.6: with a zero byte, or XML that ends
// within a comment, a tag or an element. kUnsupported for base64.
Status check_storage_text(std::string_view text, const std::string& path);

}  // namespace stgs::encoder
