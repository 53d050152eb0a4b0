// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "stgs/format/status.h"

namespace stgs::player {

// Returns the proxy that the environment states for a URL, or "": http_proxy or https_proxy, else
// all_proxy, unless no_proxy lists the host. As libcurl decides, but known before connecting.
std::string proxy_of(const std::string& url);

// A proxy without its userinfo, which messages of libcurl would contain.
struct Proxy {
  std::string url;  // empty: none
  // Decoded; without value if the proxy has no userinfo.
  std::optional<std::string> user, password;
};

// Parses a proxy as libcurl does: [SCHEME://][USER[:PASSWORD]@]HOST[:PORT], or "" for none.
// kUsage if it is malformed. The error states the reason alone.
Result<Proxy> parse_proxy(const std::string& text);

}  // namespace stgs::player
