// SPDX-License-Identifier: Apache-2.0
#include "printable.h"

#include <fmt/format.h>

#include <cctype>

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
  constexpr std::string_view kSlashes = "/\\", kEnds = " \t\n\"'<>";
  std::string out;
  for (std::size_t at = 0;;) {
    const std::size_t colon = text.find(':', at);
    const std::size_t begin =
        colon == std::string_view::npos
            ? text.size()
            : std::min(text.find_first_not_of(kSlashes, colon + 1), text.size());
    const bool is_scheme = colon != std::string_view::npos && colon > 0 && begin > colon + 1 &&
                           std::isalnum(static_cast<unsigned char>(text[colon - 1])) != 0;
    out += text.substr(at, begin - at);
    if (begin == text.size()) return out;
    at = begin;
    if (!is_scheme) continue;
    const std::size_t end = std::min(text.find_first_of(kEnds, begin), text.size());
    std::string_view url = text.substr(begin, end - begin);
    // A password may contain the characters that end the authority of a URL.
    const std::size_t user = url.rfind('@');
    const std::string_view before = url.substr(0, user);
    if (user != std::string_view::npos && (before.find(':') != std::string_view::npos ||
                                           before.find_first_of("/?#") == std::string_view::npos)) {
      url.remove_prefix(user + 1);
    }
    const std::size_t query = std::min(url.find('?'), url.size());
    out += url.substr(0, query);
    // After a query, a message has one of these.
    if (query < url.size() && (url.ends_with(':') || url.ends_with(';') || url.ends_with(',')))
      out += url.back();
    at = end;
  }
}

std::string printable(std::string_view text) {
  return escaped(text, true);
}

std::string one_line(std::string_view text) {
  return escaped(text, false);
}

}  // namespace stgs::tools
