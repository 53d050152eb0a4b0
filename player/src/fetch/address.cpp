// SPDX-License-Identifier: Apache-2.0
#include "fetch/address.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <optional>

namespace stgs::player {
namespace {

struct NetworkV4 {
  std::uint32_t address;
  int bits;
};

// The special-purpose addresses of the IANA registry (RFC 6890) and multicast. Also the few that
// are reachable from everywhere: none of them has a server with scenes.
constexpr NetworkV4 kPrivateV4[] = {
    {0x00000000, 8},   // 0.0.0.0: this host
    {0x0a000000, 8},   // 10.0.0.0: private
    {0x64400000, 10},  // 100.64.0.0: shared by the customers of a provider
    {0x7f000000, 8},   // 127.0.0.0: loopback
    {0xa9fe0000, 16},  // 169.254.0.0: link-local
    {0xac100000, 12},  // 172.16.0.0: private
    {0xc0000000, 24},  // 192.0.0.0: protocol assignments
    {0xc0000200, 24},  // 192.0.2.0: documentation
    {0xc01fc400, 24},  // 192.31.196.0: AS112, a name server of each network
    {0xc034c100, 24},  // 192.52.193.0: relays of multicast
    {0xc0586300, 24},  // 192.88.99.0: 6to4 relays
    {0xc0a80000, 16},  // 192.168.0.0: private
    {0xc0af3000, 24},  // 192.175.48.0: AS112
    {0xc6120000, 15},  // 198.18.0.0: benchmarks
    {0xc6336400, 24},  // 198.51.100.0: documentation
    {0xcb007100, 24},  // 203.0.113.0: documentation
    {0xe0000000, 3},   // 224.0.0.0 and later: multicast, reserved, broadcast
};

bool is_private_v4(std::uint32_t address) {
  return std::any_of(std::begin(kPrivateV4), std::end(kPrivateV4), [&](const NetworkV4& network) {
    return (address ^ network.address) >> (32 - network.bits) == 0;
  });
}

struct NetworkV6 {
  std::uint64_t address;  // the upper half
  int bits;
};

// As above, of the unicast addresses of the Internet.
constexpr NetworkV6 kPrivateV6[] = {
    {0x2001000000000000, 23},  // protocol assignments
    {0x20010db800000000, 32},  // documentation
    {0x2620004f80000000, 48},  // AS112
    {0x3fff000000000000, 20},  // documentation
};

bool is_private_v6(const std::uint8_t* a) {
  const auto begins_with = [&](std::initializer_list<std::uint8_t> bytes) {
    return std::equal(bytes.begin(), bytes.end(), a);
  };
  const auto embedded = [&](int at) {
    return std::uint32_t{a[at]} << 24 | std::uint32_t{a[at + 1]} << 16 |
           std::uint32_t{a[at + 2]} << 8 | a[at + 3];
  };
  const bool is_low = begins_with({0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  // ::ffff:a.b.c.d, and ::a.b.c.d with :: and ::1.
  if (is_low && ((a[10] == 0xff && a[11] == 0xff) || (a[10] == 0 && a[11] == 0))) {
    return is_private_v4(embedded(12));
  }
  if (begins_with({0x00, 0x64, 0xff, 0x9b, 0, 0, 0, 0, 0, 0, 0, 0})) {  // NAT64
    return is_private_v4(embedded(12));
  }
  if (begins_with({0x20, 0x02})) return is_private_v4(embedded(2));  // 6to4
  if (begins_with({0x20, 0x01, 0, 0})) {  // Teredo: the server and the client
    return is_private_v4(embedded(4)) || is_private_v4(~embedded(12));
  }
  // ISATAP: an interface of any network, ::0:5efe:a.b.c.d or ::200:5efe:a.b.c.d.
  const bool is_isatap = (a[8] & ~2) == 0 && a[9] == 0 && a[10] == 0x5e && a[11] == 0xfe;
  if (is_isatap && is_private_v4(embedded(12))) return true;
  std::uint64_t upper = 0;
  for (int i = 0; i < 8; ++i) upper = upper << 8 | a[i];
  const bool is_special =
      std::any_of(std::begin(kPrivateV6), std::end(kPrivateV6), [&](const NetworkV6& network) {
        return (upper ^ network.address) >> (64 - network.bits) == 0;
      });
  return is_special || a[0] >> 5 != 1;  // unicast addresses of the Internet are in 2000::/3
}

// A host without brackets, zone and trailing dot, in lower case.
std::string plain_host(std::string_view host) {
  if (host.starts_with('[')) {
    host.remove_prefix(1);
    host = host.substr(0, host.find_first_of("]%"));
  }
  if (host.ends_with('.')) host.remove_suffix(1);
  std::string plain(host);
  for (char& c : plain) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return plain;
}

std::optional<sockaddr_storage> parse_address(const std::string& host) {
  sockaddr_storage storage{};
  sockaddr_in v4{};
  sockaddr_in6 v6{};
  if (inet_pton(AF_INET, host.c_str(), &v4.sin_addr) == 1) {
    v4.sin_family = AF_INET;
    std::memcpy(&storage, &v4, sizeof(v4));
  } else if (inet_pton(AF_INET6, host.c_str(), &v6.sin6_addr) == 1) {
    v6.sin6_family = AF_INET6;
    std::memcpy(&storage, &v6, sizeof(v6));
  } else {
    return std::nullopt;
  }
  return storage;
}

}  // namespace

bool is_private(const sockaddr& address) {
  if (address.sa_family == AF_INET) {
    sockaddr_in v4;
    std::memcpy(&v4, &address, sizeof(v4));
    return is_private_v4(ntohl(v4.sin_addr.s_addr));
  }
  if (address.sa_family != AF_INET6) return true;
  sockaddr_in6 v6;
  std::memcpy(&v6, &address, sizeof(v6));
  return is_private_v6(v6.sin6_addr.s6_addr);
}

std::string address_text(const sockaddr& address) {
  char text[INET6_ADDRSTRLEN] = "";
  if (address.sa_family == AF_INET) {
    sockaddr_in v4;
    std::memcpy(&v4, &address, sizeof(v4));
    (void)inet_ntop(AF_INET, &v4.sin_addr, text, sizeof(text));
  } else if (address.sa_family == AF_INET6) {
    sockaddr_in6 v6;
    std::memcpy(&v6, &address, sizeof(v6));
    (void)inet_ntop(AF_INET6, &v6.sin6_addr, text, sizeof(text));
  }
  return text;
}

bool is_address(std::string_view host) {
  return parse_address(plain_host(host)).has_value();
}

bool is_local_name(std::string_view host) {
  const std::string name = plain_host(host);
  if (name.empty() || is_address(name)) return false;
  return name.find('.') == std::string::npos || name.ends_with(".local") ||
         name.ends_with(".localhost");
}

bool is_private_host(std::string_view host) {
  const auto address = parse_address(plain_host(host));
  if (!address) return is_local_name(host);
  return is_private(reinterpret_cast<const sockaddr&>(*address));
}

bool is_same_host(std::string_view a, std::string_view b) {
  return plain_host(a) == plain_host(b);
}

}  // namespace stgs::player
