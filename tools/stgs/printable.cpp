// SPDX-License-Identifier: Apache-2.0
#include "printable.h"

#include <fmt/format.h>

#include <algorithm>

#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

std::string escaped(std::string_view text, bool keep_lines) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    const auto next = static_cast<unsigned char>(i + 1 < text.size() ? text[i + 1] : 0);
    if (c == 0xC2 && next >= 0x80 && next < 0xA0) {  // U+0080 to U+009F
      out += fmt::format("\\x{:02x}", next);
      ++i;
    } else if ((c < 0x20 || c == 0x7F) && !(keep_lines && (c == '\n' || c == '\t'))) {
      out += fmt::format("\\x{:02x}", c);
    } else {
      out += text[i];
    }
  }
  return out;
}

}  // namespace

std::string without_secrets(std::string_view text) {
  constexpr std::string_view kSpaces = " \t\n\"'<>()", kPunctuation = ":;,.";
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t begin = std::min(text.find_first_not_of(kSpaces, at), text.size());
    const std::size_t end = std::min(text.find_first_of(kSpaces, begin), text.size());
    std::string_view word = text.substr(begin, end - begin);
    word = word.substr(0, word.find_last_not_of(kPunctuation) + 1);
    out += text.substr(at, begin - at);
    out += player::display_location(std::string(word));
    at = begin + word.size();
    out += text.substr(at, end - at);
    at = end;
  }
  return out;
}

std::string printable(std::string_view text) {
  return escaped(text, true);
}

std::string one_line(std::string_view text) {
  return escaped(text, false);
}

}  // namespace stgs::tools
