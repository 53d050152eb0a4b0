// SPDX-License-Identifier: Apache-2.0
#include "export.h"

#include <utility>

#include <fmt/format.h>

namespace stgs::web {

const char* give(std::string value) {
  static std::string text;
  text = std::move(value);
  return text.c_str();
}

std::string quoted(const std::string& value) {
  std::string out = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') {
      out += {'\\', c};
    } else if (static_cast<unsigned char>(c) < 0x20) {
      out += fmt::format("\\u{:04x}", static_cast<int>(c));
    } else {
      out += c;
    }
  }
  return out + '"';
}

}  // namespace stgs::web
