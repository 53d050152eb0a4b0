// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace stgs::player {

// Returns the proxy that the environment states for a URL, or "": http_proxy or https_proxy, else
// all_proxy, unless no_proxy lists the host. As libcurl decides, but known before connecting.
std::string proxy_of(const std::string& url);

}  // namespace stgs::player
