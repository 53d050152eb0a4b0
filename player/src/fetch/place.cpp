// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <string_view>

#include "stgs/player/source.h"

namespace stgs::player {

// A scheme may be written in capitals (RFC 3986, 3.1).
bool is_url(const std::string& place) {
  std::string scheme = place.substr(0, std::string_view("https://").size());
  for (char& c : scheme) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return scheme.starts_with("http://") || scheme == "https://";
}

std::string display_location(const std::string& place) {
  if (!is_url(place)) return place;
  const std::size_t host = place.find("//") + 2;
  std::string shown = place.substr(0, std::min(place.find_first_of("?#", host), place.size()));
  const std::size_t path = std::min(shown.find('/', host), shown.size());
  const std::size_t user = shown.rfind('@', path);
  if (user != std::string::npos && user >= host) shown.erase(host, user + 1 - host);
  return shown;
}

Result<std::unique_ptr<ByteSource>> open_location(const std::string& place,
                                                  const HttpSettings& settings) {
  if (!is_url(place) && place.find("://") != std::string::npos) {
    return usage_error("{}: only URLs that begin with http:// or https:// can be read", place);
  }
  if (!is_url(place)) return open_file(place);
  STGS_ASSIGN(std::unique_ptr<HttpSource> source, open_url(place, settings));
  return std::unique_ptr<ByteSource>(std::move(source));
}

}  // namespace stgs::player
