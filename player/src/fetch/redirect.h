// SPDX-License-Identifier: Apache-2.0
// Which URLs and addresses a server may lead to.
#pragma once

#include <string>

#include "stgs/format/status.h"

struct sockaddr;

namespace stgs::player {

inline constexpr int kMaxRedirects = 5;  // per attempt

// Returns the host of a URL as libcurl reads it, or "".
std::string host_of(const std::string& url);
// Returns the scheme of a URL in lower case, or "".
std::string scheme_of(const std::string& url);
// Returns scheme, host and port of a URL, for comparison.
std::string origin_of(const std::string& url);

// Resolves the Location header of a response to a request for `from`. The result has no fragment;
// it has the userinfo of `from` if scheme, host and port are the same, else none. kIo if the
// target is malformed, not http or https, or http after https. Errors state the reason alone.
Result<std::string> redirect_target(const std::string& from, const std::string& location);

// Which hosts may have private addresses. An address as host, localhost, a single label or a name
// below .local, if it is the URL that the user gave; other hosts, such as those of redirections,
// only if all private addresses are allowed.
class HostRules {
 public:
  HostRules(const std::string& url, bool allow_private);

  // Returns whether `host` may have a private address.
  bool may_be_private(const std::string& host) const;
  // Checks the host of a redirection before it is connected to: kIo if it is a local name or a
  // private address that is not allowed. The error states the reason alone.
  Status check_target(const std::string& url) const;

 private:
  std::string local_host_;  // of the user's URL, if that is an address or a local name
  bool allow_private_;
};

// States that a host has an address that it must not have.
std::string private_address_refused(const std::string& host, const std::string& address);

}  // namespace stgs::player
