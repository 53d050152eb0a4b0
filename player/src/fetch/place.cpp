// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/source.h"

namespace stgs::player {

bool is_url(const std::string& place) {
  return place.starts_with("http://") || place.starts_with("https://");
}

Result<std::unique_ptr<ByteSource>> open_place(const std::string& place,
                                               const HttpSettings& settings) {
  if (!is_url(place) && place.find("://") != std::string::npos) {
    return usage_error("{}: only URLs that begin with http:// or https:// can be read", place);
  }
  if (!is_url(place)) return open_file(place);
  STGS_ASSIGN(std::unique_ptr<HttpSource> source, open_url(place, settings));
  return std::unique_ptr<ByteSource>(std::move(source));
}

}  // namespace stgs::player
