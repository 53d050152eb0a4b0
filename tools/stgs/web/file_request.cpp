// SPDX-License-Identifier: Apache-2.0
#include "file_request.h"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>

namespace stgs::tools {
namespace {

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

// Returns whether a list of entity tags contains `etag` or "*". `weak`: W/ is ignored.
bool contains_tag(std::string_view list, std::string_view etag, bool weak) {
  if (trimmed(list) == "*") return true;
  while (!list.empty()) {
    const std::size_t comma = std::min(list.find(','), list.size());
    std::string_view tag = trimmed(list.substr(0, comma));
    list.remove_prefix(std::min(comma + 1, list.size()));
    if (weak && tag.substr(0, 2) == "W/") tag.remove_prefix(2);
    if (tag == etag) return true;
  }
  return false;
}

// Parses digits alone. Larger numbers than 2^64 - 1 become that.
std::optional<std::uint64_t> parse_number(std::string_view text) {
  if (text.empty() || !std::all_of(text.begin(), text.end(),
                                   [](unsigned char c) { return std::isdigit(c) != 0; })) {
    return {};
  }
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() ? value : UINT64_MAX;
}

// The value of Range: nothing if it is to be ignored, because it is malformed or has several
// ranges.
std::optional<FileAnswer> answer_range(std::string_view range, std::uint64_t bytes) {
  constexpr std::string_view kUnit = "bytes=";
  if (range.substr(0, kUnit.size()) != kUnit) return {};
  range = trimmed(range.substr(kUnit.size()));
  const std::size_t dash = range.find('-');
  if (dash == std::string_view::npos || range.find(',') != std::string_view::npos) return {};
  const std::string_view first_text = range.substr(0, dash), last_text = range.substr(dash + 1);
  const auto first = parse_number(first_text), last = parse_number(last_text);
  if ((!first_text.empty() && !first) || (!last_text.empty() && !last) || (!first && !last))
    return {};
  if (!first) {  // the last bytes
    const std::uint64_t length = std::min(*last, bytes);
    if (length == 0) return FileAnswer{416, 0, 0};
    return FileAnswer{206, bytes - length, length};
  }
  if (last && *last < *first) return {};
  if (*first >= bytes) return FileAnswer{416, 0, 0};
  const std::uint64_t end = last ? std::min(*last, bytes - 1) : bytes - 1;
  return FileAnswer{206, *first, end - *first + 1};
}

bool is_address(const std::string& text, int family) {
  std::array<unsigned char, sizeof(in6_addr)> address{};
  return ::inet_pton(family, text.c_str(), address.data()) == 1;
}

}  // namespace

FileAnswer answer_file(const FileVersion& version, const FileRequest& request) {
  if (request.if_match && !contains_tag(*request.if_match, version.etag, false)) return {412, 0, 0};
  // Without If-None-Match, the date decides, which must be exactly that of the file, as in nginx.
  const bool is_known = request.if_none_match
                            ? contains_tag(*request.if_none_match, version.etag, true)
                            : request.if_modified_since == version.last_modified;
  if (is_known) return {304, 0, 0};
  const bool is_version = !request.if_range || trimmed(*request.if_range) == version.etag ||
                          trimmed(*request.if_range) == version.last_modified;
  if (request.range && is_version) {
    if (const auto answer = answer_range(*request.range, version.bytes)) return *answer;
  }
  return {200, 0, version.bytes};
}

std::string http_date(std::time_t time) {
  static constexpr std::array<const char*, 7> kDays = {"Sun", "Mon", "Tue", "Wed",
                                                       "Thu", "Fri", "Sat"};
  static constexpr std::array<const char*, 12> kMonths = {"Jan", "Feb", "Mar", "Apr", "May", "Jun",
                                                          "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"};
  std::tm t{};
  ::gmtime_r(&time, &t);
  std::array<char, 64> text{};
  // Not strftime(), whose names depend on the locale.
  std::snprintf(text.data(), text.size(), "%s, %02d %s %04d %02d:%02d:%02d GMT",
                kDays[static_cast<std::size_t>(t.tm_wday)], t.tm_mday,
                kMonths[static_cast<std::size_t>(t.tm_mon)], t.tm_year + 1900, t.tm_hour, t.tm_min,
                t.tm_sec);
  return text.data();
}

std::optional<std::string> decode_url_path(std::string_view path) {
  std::string out;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (path[i] != '%') {
      out += path[i];
      continue;
    }
    const std::string_view digits = path.substr(i + 1, 2);
    unsigned value = 0;
    const auto [end, error] =
        std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
    const bool whole = digits.size() == 2 && end == digits.data() + 2;
    if (error != std::errc() || !whole || value == 0) return {};
    out += static_cast<char>(value);
    i += 2;
  }
  return out;
}

bool is_scene_name(std::string_view name) {
  constexpr std::string_view kEnding = ".stgs";
  if (name.size() < kEnding.size() || name.substr(name.size() - kEnding.size()) != kEnding)
    return false;
  for (std::size_t begin = 0; begin <= name.size();) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    if (end == begin || name[begin] == '.') return false;
    begin = end + 1;
  }
  return true;
}

bool is_permitted_host(std::string_view host) {
  if (host.substr(0, 1) == "[") {
    const std::size_t end = host.find(']');
    if (end == std::string_view::npos) return false;
    const std::string_view port = host.substr(end + 1);
    return (port.empty() || port.front() == ':') &&
           is_address(std::string(host.substr(1, end - 1)), AF_INET6);
  }
  std::string name(host.substr(0, host.find(':')));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name == "localhost" || is_address(name, AF_INET);
}

}  // namespace stgs::tools
