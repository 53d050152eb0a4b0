// SPDX-License-Identifier: Apache-2.0
#include "json_error.h"

#include <regex>

namespace stgs::encoder {
namespace {

constexpr std::size_t kMaxText = 400;  // bytes; std::regex recurses for every one

}  // namespace

Result<nlohmann::json> parse_json_text(std::string_view text, const std::string& where) {
  STGS_TRY(check_json_nesting(text, where));
  try {
    return nlohmann::json::parse(text);
  } catch (const nlohmann::json::exception& error) {
    return invalid_file("{}: {}", where, json_error(error));
  }
}

std::string json_error(const std::exception& error) {
  std::string text = short_text(error.what(), kMaxText);  // with tokens of the file, of any length
  if (dynamic_cast<const nlohmann::json::exception*>(&error) == nullptr) return text;
  // "[json.exception.out_of_range.403] key 'height' not found"
  if (const std::size_t end = text.find("] "); end != std::string::npos) text.erase(0, end + 2);
  // "parse error at line 1, column 9: syntax error while parsing array - unexpected ']'; ..."
  static const std::regex parse(
      R"(parse error at (line \d+, column \d+): (?:syntax error while parsing [^-]* - )?)");
  static const std::regex missing(R"(key '(.*)' not found)");
  text = std::regex_replace(text, parse,
                            "not valid JSON at $1: ", std::regex_constants::format_first_only);
  return std::regex_replace(text, missing, "\"$1\" is missing");
}

}  // namespace stgs::encoder
