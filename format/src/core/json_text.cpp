// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/json_text.h"

namespace stgs {

Status check_json_nesting(std::string_view text, const std::string& label) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      in_string = c != '"';
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++depth <= kMaxJsonNesting) continue;
      return invalid_file("{}: more than {} nested arrays and objects [byte {}]", label,
                          kMaxJsonNesting, i);
    } else if (c == ']' || c == '}') {
      --depth;
    }
  }
  return {};
}

std::string short_text(std::string text, std::size_t max) {
  if (text.size() <= max) return text;
  while (max > 0 && (static_cast<unsigned char>(text[max]) & 0xC0) == 0x80) --max;
  text.resize(max);
  return text + "...";
}

}  // namespace stgs
