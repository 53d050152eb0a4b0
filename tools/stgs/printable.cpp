// SPDX-License-Identifier: Apache-2.0
#include "printable.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

struct Character {
  std::uint32_t code = 0;
  std::size_t bytes = 0;  // 0: not UTF-8
};

// Returns the first character of a text that is not empty.
Character first_character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  if (first < 0x80) return {first, 1};
  const std::size_t bytes = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC0 || first > 0xF4 || bytes > text.size()) return {};
  std::uint32_t code = first & (0x7Fu >> bytes);
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return {};
    code = code << 6 | (byte(i) & 0x3Fu);
  }
  constexpr std::uint32_t kSmallest[] = {0x80, 0x800, 0x10000};  // of 2, 3 and 4 bytes
  const bool is_surrogate = code >= 0xD800 && code < 0xE000;
  if (code < kSmallest[bytes - 2] || is_surrogate || code > 0x10FFFF) return {};
  return {code, bytes};
}

// Returns whether a character changes the direction of the text around it.
bool is_bidirectional_control(std::uint32_t code) {
  return code == 0x061C || code == 0x200E || code == 0x200F || (code >= 0x202A && code <= 0x202E) ||
         (code >= 0x2066 && code <= 0x2069);
}

std::string escaped(std::string_view text, bool keep_lines) {
  std::string out;
  while (!text.empty()) {
    const Character c = first_character(text);
    const std::size_t bytes = std::max<std::size_t>(c.bytes, 1);
    const bool is_control = c.code < 0x20 || (c.code >= 0x7F && c.code < 0xA0);
    if (c.bytes == 0) {
      out += fmt::format("\\x{:02x}", static_cast<unsigned char>(text[0]));
    } else if (is_control && !(keep_lines && (c.code == '\n' || c.code == '\t'))) {
      out += fmt::format("\\x{:02x}", c.code);
    } else if (is_bidirectional_control(c.code)) {
      out += fmt::format("\\u{:04x}", c.code);
    } else {
      out += text.substr(0, bytes);
    }
    text.remove_prefix(bytes);
  }
  return out;
}

}  // namespace

std::string without_secrets(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\n", kQuotes = " \t\n\"'<>()",
                             kPunctuation = ":;,.\"'<>()";
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t begin = std::min(text.find_first_not_of(kQuotes, at), text.size());
    std::size_t end = std::min(text.find_first_of(kQuotes, begin), text.size());
    // Userinfo and queries may contain quotes and parentheses.
    const std::string_view part = text.substr(begin, end - begin);
    const bool is_url = part.find(":/") != part.npos || part.find(":\\") != part.npos;
    if (is_url) end = std::min(text.find_first_of(kBlanks, begin), text.size());
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

std::string without_secrets(std::string_view text, const std::vector<std::string>& arguments) {
  std::string shown(text);
  for (const std::string& argument : arguments) {
    const std::size_t colon = std::min(argument.find(":/"), argument.find(":\\"));
    if (colon == std::string::npos) continue;
    // The scheme may follow the name of an option, as in -ohttp://.
    const std::string url = argument.substr(colon);
    const std::string shown_url = player::display_location("x" + url).substr(1);
    if (shown_url == url) continue;
    for (std::size_t at = shown.find(url); at != shown.npos; at = shown.find(url, at)) {
      shown.replace(at, url.size(), shown_url);
      at += shown_url.size();
    }
  }
  return without_secrets(shown);
}

std::string printable(std::string_view text) {
  return escaped(text, true);
}

std::string one_line(std::string_view text) {
  return escaped(text, false);
}

}  // namespace stgs::tools
