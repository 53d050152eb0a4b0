// SPDX-License-Identifier: Apache-2.0
#include "fetch/redirect.h"

#include <arpa/inet.h>
#include <curl/curl.h>
#include <netinet/in.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <string_view>

#include "fetch/address.h"

namespace stgs::player {
namespace {

// A parsed URL.
class Url {
 public:
  explicit Url(const std::string& text, unsigned flags = 0) : url_(curl_url()) {
    if (url_ == nullptr) return;
    is_valid_ = curl_url_set(url_.get(), CURLUPART_URL, text.c_str(), flags) == CURLUE_OK;
  }
  bool is_valid() const { return is_valid_; }
  // Returns a part, or "".
  std::string get(CURLUPart part, unsigned flags = 0) const {
    char* text = nullptr;
    if (!is_valid_ || curl_url_get(url_.get(), part, &text, flags) != CURLUE_OK) return {};
    const std::unique_ptr<char, decltype(&curl_free)> owned(text, curl_free);
    return text;
  }
  // Sets a part; "" removes it. A URL is resolved against the present one.
  bool set(CURLUPart part, const std::string& text) {
    const char* value = text.empty() ? nullptr : text.c_str();
    return is_valid_ && curl_url_set(url_.get(), part, value, 0) == CURLUE_OK;
  }
  std::string scheme() const { return get(CURLUPART_SCHEME); }
  std::string port() const { return get(CURLUPART_PORT, CURLU_DEFAULT_PORT); }

 private:
  struct Free {
    void operator()(CURLU* url) const { curl_url_cleanup(url); }
  };
  std::unique_ptr<CURLU, Free> url_;
  bool is_valid_ = false;
};

constexpr std::string_view kHint = "set url_allow_private if you trust the server";

}  // namespace

std::string host_of(const std::string& url) {
  return Url(url).get(CURLUPART_HOST);
}

std::string scheme_of(const std::string& url) {
  return Url(url).scheme();
}

std::string origin_of(const std::string& url) {
  const Url parsed(url);
  return fmt::format("{}://{}:{}", parsed.scheme(), parsed.get(CURLUPART_HOST), parsed.port());
}

Result<std::string> redirect_target(const std::string& from, const std::string& location) {
  const Url before(from);
  Url target(from);
  if (location.empty() || !target.set(CURLUPART_URL, location)) {
    return io_error("the server redirects to a malformed or unsupported URL");
  }
  const std::string scheme = target.scheme();
  if (scheme != "http" && scheme != "https") {
    return io_error("the server redirects to a URL of the scheme {} (expected http or https)",
                    scheme);
  }
  if (scheme == "http" && before.scheme() == "https") {
    return io_error("the server redirects from https to http, which is not encrypted");
  }
  const bool is_same_origin = scheme == before.scheme() && target.port() == before.port() &&
                              is_same_host(target.get(CURLUPART_HOST), before.get(CURLUPART_HOST));
  for (const CURLUPart part : {CURLUPART_USER, CURLUPART_PASSWORD, CURLUPART_OPTIONS}) {
    target.set(part, is_same_origin ? before.get(part) : "");
  }
  target.set(CURLUPART_FRAGMENT, "");
  std::string url = target.get(CURLUPART_URL);
  if (url.empty()) return io_error("the server redirects to a malformed URL");
  return url;
}

HostRules::HostRules(const std::string& url, bool allow_private) : allow_private_(allow_private) {
  const std::string host = host_of(url);
  if (is_address(host) || is_local_name(host)) local_host_ = host;
}

bool HostRules::may_be_private(const std::string& host) const {
  return allow_private_ || (!local_host_.empty() && is_same_host(host, local_host_));
}

Status HostRules::check_target(const std::string& url) const {
  const std::string host = host_of(url);
  if (!is_private_host(host) || may_be_private(host)) return {};
  return io_error("the server redirects to {}, a host of a private network; {}", host, kHint);
}

std::string private_address_refused(const std::string& host, const std::string& address) {
  return fmt::format("{} has the address {} of a private network; {}", host, address, kHint);
}

}  // namespace stgs::player
