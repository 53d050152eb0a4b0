// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <string_view>

#include "stgs/player/source.h"

namespace stgs::player {

// Schemes are case-insensitive (RFC 3986, 3.1).
bool is_url(const std::string& location) {
  std::string scheme = location.substr(0, std::string_view("https://").size());
  for (char& c : scheme) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return scheme.starts_with("http://") || scheme == "https://";
}

// A password may contain unescaped characters that end the authority, '/', '?' and '#', although no
// URL does (RFC 3986, 3.2). An authority that looks like "user:pass", followed by an '@' further
// on, is hidden up to the last such '@'; also one that has no host after its own '@'. A user name
// may contain a backslash (a Windows domain).
std::string display_location(const std::string& location) {
  const std::size_t colon = location.find(':');
  if (colon == 0 || colon == std::string::npos ||
      std::isalnum(static_cast<unsigned char>(location[colon - 1])) == 0) {
    return location;
  }
  const std::size_t host = std::min(location.find_first_not_of("/\\", colon + 1), location.size());
  if (host == colon + 1) return location;
  std::string shown = location;
  const auto authority_end = [&] {
    return std::min(shown.find_first_of("/?#", host), shown.size());
  };
  const std::size_t user = shown.rfind('@', authority_end());
  const bool has_user = user != std::string::npos && user >= host;
  if (has_user) shown.erase(host, user + 1 - host);
  const std::size_t end = authority_end();
  const bool has_colon = shown.find(':', host) < end;
  const bool has_host = host < end && shown[host] != '\\';
  if ((has_colon || (has_user && !has_host)) && end < shown.size()) {
    // A query of a URL with a path may contain an '@'.
    const std::size_t last = shown[end] == '/' ? shown.find_first_of("?#", end) : shown.size();
    const std::size_t at = shown.substr(0, last).rfind('@');
    if (at != std::string::npos && at > end) shown.replace(host, at - host, "***");
  }
  shown.resize(std::min(shown.find_first_of("?#", host), shown.size()));
  return shown;
}

Result<std::unique_ptr<ByteSource>> open_location(const std::string& location,
                                                  const HttpSettings& settings) {
  if (!is_url(location) && location.find("://") != std::string::npos) {
    return usage_error("{}: unsupported URL scheme (expected http:// or https://)",
                       display_location(location));
  }
  if (!is_url(location)) return open_file(location);
  const std::size_t host = location.find("//") + 2;
  if (host == location.size() ||
      std::string_view("/\\?#").find(location[host]) != std::string_view::npos) {
    return usage_error("{}: a URL without a host", display_location(location));
  }
  STGS_ASSIGN(std::unique_ptr<HttpSource> source, open_url(location, settings));
  return std::unique_ptr<ByteSource>(std::move(source));
}

}  // namespace stgs::player
