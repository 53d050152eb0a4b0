// SPDX-License-Identifier: Apache-2.0
// Addresses and host names of private networks.
#pragma once

#include <string>
#include <string_view>

struct sockaddr;

namespace stgs::player {

// Returns whether a public host cannot have this address: loopback, link-local, private, shared,
// multicast and reserved addresses of IPv4 and IPv6 (RFC 6890), IPv6 forms that embed such an IPv4
// address (mapped, compatible, NAT64, 6to4, Teredo), and addresses of any other family.
bool is_private(const sockaddr& address);

// Returns the address as text, without the port.
std::string address_text(const sockaddr& address);

// Returns whether `host`, as in a URL, is an address, with or without brackets.
bool is_address(std::string_view host);

// Returns whether `host` is a name that only a local network gives a meaning to: localhost, a
// single label, or a name below .local or .localhost.
bool is_local_name(std::string_view host);

// Returns whether `host` is a local name or a private address.
bool is_private_host(std::string_view host);

// Returns whether two hosts of URLs are equal.
bool is_same_host(std::string_view a, std::string_view b);

}  // namespace stgs::player
