// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/text.h"

#include <cerrno>
#include <cstddef>
#include <cstdint>

#include "stgs/format/escape.h"
#include "stgs/format/status.h"

namespace stgs {

bool is_utf8(std::string_view text) {
  // Smallest code point of each length.
  constexpr std::uint32_t kFirst[] = {0, 0, 0x80, 0x800, 0x10000};
  for (std::size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const std::size_t length = lead < 0x80             ? 1
                               : (lead & 0xE0) == 0xC0 ? 2
                               : (lead & 0xF0) == 0xE0 ? 3
                               : (lead & 0xF8) == 0xF0 ? 4
                                                       : 0;
    if (length == 0 || length > text.size() - i) return false;
    std::uint32_t point = length == 1 ? lead : lead & (0x7Fu >> length);
    for (std::size_t j = 1; j < length; ++j) {
      const auto byte = static_cast<unsigned char>(text[i + j]);
      if ((byte & 0xC0) != 0x80) return false;
      point = point << 6 | (byte & 0x3Fu);
    }
    const bool surrogate = point >= 0xD800 && point < 0xE000;
    if (point < kFirst[length] || point > 0x10FFFF || surrogate) return false;
    i += length;
  }
  return true;
}

std::string file_problem(int error) {
  const std::string text = system_message(error);
  switch (error) {
    case ENOENT:
      return text + "; check the name";
    case EACCES:
    case EPERM:
      return text + "; check the permissions";
    case EROFS:
    case ENOSPC:
      return text + "; choose another folder";
    default:
      return text;
  }
}

std::string escape_html(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string escape_url(std::string_view text, std::string_view plain) {
  std::string out;
  for (const char c : text) {
    const bool alphanumeric =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    const bool stays = alphanumeric || plain.find(c) != std::string_view::npos;
    out += stays ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return out;
}

}  // namespace stgs
