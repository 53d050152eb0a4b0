// SPDX-License-Identifier: Apache-2.0
// JSON of other programs: limits and texts that all its readers share.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "stgs/format/status.h"

namespace stgs {

// Greatest nesting of arrays and objects. Functions that recurse over values, such as copies and
// dumps, then need little stack.
inline constexpr int kMaxJsonNesting = 64;

// Returns kInvalidFile if arrays and objects of the text nest deeper than kMaxJsonNesting. Call it
// before parsing. Exact for valid JSON. `label` is for the message.
Status check_json_nesting(std::string_view text, const std::string& label);

// Returns a text of at most `max` bytes, shortened with "..." between UTF-8 characters.
std::string short_text(std::string text, std::size_t max);

// Returns a value for messages: a scalar, shortened, or only the type of an array or object.
// `Json` is nlohmann::json or ordered_json.
template <typename Json>
std::string short_json(const Json& value) {
  constexpr std::size_t kMaxText = 60;  // bytes
  if (value.is_structured()) return std::string("an ") + value.type_name();
  return short_text(value.dump(-1, ' ', false, Json::error_handler_t::replace), kMaxText);
}

}  // namespace stgs
