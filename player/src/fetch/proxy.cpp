// SPDX-License-Identifier: Apache-2.0
#include "fetch/proxy.h"

#include <arpa/inet.h>
#include <curl/curl.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string_view>

#include "fetch/redirect.h"

namespace stgs::player {
namespace {

// Returns the first of the environment's variables that is set and not empty, or "".
std::string environment(std::initializer_list<const char*> names) {
  for (const char* name : names) {
    const char* value = std::getenv(name);
    if (value != nullptr && *value != 0) return value;
  }
  return {};
}

// The bytes of an address; none if `text` is a name.
struct Address {
  std::array<std::uint8_t, 16> bytes{};
  unsigned bits = 0;  // 32 or 128; 0: none
};

Address address_of(std::string text) {
  Address out;
  if (::inet_pton(AF_INET, text.c_str(), out.bytes.data()) == 1) {
    out.bits = 32;
  } else if (::inet_pton(AF_INET6, text.c_str(), out.bytes.data()) == 1) {
    out.bits = 128;
  }
  return out;
}

// Returns whether an address lies in a range such as 10.0.0.0/8. Without a length it is one
// address.
bool contains(std::string_view range, const Address& address) {
  const std::size_t slash = range.find('/');
  const Address first = address_of(std::string(range.substr(0, slash)));
  unsigned length = first.bits;
  if (slash != std::string_view::npos) {
    const std::string_view text = range.substr(slash + 1);
    const auto parsed = std::from_chars(text.data(), text.data() + text.size(), length);
    if (parsed.ec != std::errc() || parsed.ptr != text.data() + text.size()) return false;
  }
  if (first.bits == 0 || first.bits != address.bits || length > first.bits) return false;
  for (unsigned bit = 0; bit < length; ++bit) {
    if (((first.bytes[bit / 8] ^ address.bytes[bit / 8]) >> (7 - bit % 8) & 1) != 0) return false;
  }
  return true;
}

// Returns a host in lower case, without brackets and without a dot at its end.
std::string normal(std::string_view host) {
  if (host.starts_with('[')) host = host.substr(1, host.find(']') - 1);
  while (host.ends_with('.')) host.remove_suffix(1);
  std::string out(host);
  for (char& c : out) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

// Returns whether an entry of no_proxy names a host: a domain and all names below it, an address or
// a range of addresses.
bool names(std::string_view entry, const std::string& host, const Address& address) {
  if (entry == "*") return true;
  if (address.bits != 0) return contains(normal(entry), address);
  while (entry.starts_with('.')) entry.remove_prefix(1);
  const std::string domain = normal(entry);
  return !domain.empty() && host.ends_with(domain) &&
         (host.size() == domain.size() || host[host.size() - domain.size() - 1] == '.');
}

bool is_excluded(const std::string& host) {
  const std::string list = environment({"no_proxy", "NO_PROXY"});
  const Address address = address_of(host);
  constexpr std::string_view kSeparators = ", \t";
  for (std::size_t at = 0; at < list.size();) {
    const std::size_t end = std::min(list.find_first_of(kSeparators, at), list.size());
    if (end > at && names(std::string_view(list).substr(at, end - at), host, address)) return true;
    at = end + 1;
  }
  return false;
}

}  // namespace

std::string proxy_of(const std::string& url) {
  std::string proxy = scheme_of(url) == "https" ? environment({"https_proxy", "HTTPS_PROXY"})
                                                : environment({"http_proxy"});
  if (proxy.empty()) proxy = environment({"all_proxy", "ALL_PROXY"});
  return proxy.empty() || is_excluded(normal(host_of(url))) ? std::string() : proxy;
}

Result<Proxy> parse_proxy(const std::string& text) {
  if (text.empty()) return Proxy{};
  constexpr unsigned kFlags = CURLU_NON_SUPPORT_SCHEME | CURLU_GUESS_SCHEME;
  const std::unique_ptr<CURLU, decltype(&curl_url_cleanup)> parsed(curl_url(), &curl_url_cleanup);
  const auto part = [&](CURLUPart name, unsigned flags) -> std::optional<std::string> {
    char* value = nullptr;
    if (curl_url_get(parsed.get(), name, &value, flags) != CURLUE_OK) return std::nullopt;
    const std::unique_ptr<char, decltype(&curl_free)> owned(value, &curl_free);
    return value;
  };
  if (parsed != nullptr &&
      curl_url_set(parsed.get(), CURLUPART_URL, text.c_str(), kFlags) == CURLUE_OK) {
    Proxy proxy;
    proxy.user = part(CURLUPART_USER, CURLU_URLDECODE);
    proxy.password = part(CURLUPART_PASSWORD, CURLU_URLDECODE);
    for (const CURLUPart name : {CURLUPART_USER, CURLUPART_PASSWORD, CURLUPART_OPTIONS})
      curl_url_set(parsed.get(), name, nullptr, 0);
    if (auto url = part(CURLUPART_URL, CURLU_NON_SUPPORT_SCHEME)) {
      proxy.url = std::move(*url);
      return proxy;
    }
  }
  return usage_error(
      "the proxy of the environment is malformed (expected [SCHEME://][USER:PASSWORD@]HOST:PORT); "
      "check http_proxy, https_proxy and all_proxy");
}

}  // namespace stgs::player
