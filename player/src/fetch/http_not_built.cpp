// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/source.h"

namespace stgs::player {

bool is_http_built() {
  return false;
}

Result<std::unique_ptr<HttpSource>> open_url(const std::string& url, const HttpSettings&) {
  return not_built("{}: this build cannot read URLs; build it with libcurl (STGS_WITH_HTTP)", url);
}

}  // namespace stgs::player
