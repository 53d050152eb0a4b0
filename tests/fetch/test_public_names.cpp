// SPDX-License-Identifier: Apache-2.0
// A public host name whose address is in a private network, such as that of a router or of a
// service of the machine.
#include <netdb.h>

#include <cstdlib>

#include "catch.h"
#include "small_server.h"
#include "stgs/player/source.h"

namespace {

struct Entry {
  addrinfo info{};
  sockaddr_in address{};
};

}  // namespace

// Replaces the C library's functions for libcurl: every name has the address 127.0.0.1. Exported by
// the program, whose symbols are hidden otherwise.
extern "C" __attribute__((visibility("default"))) int getaddrinfo(const char*, const char* service,
                                                                  const addrinfo*,
                                                                  addrinfo** found) {
  auto* const entry = new Entry;
  entry->address.sin_family = AF_INET;
  entry->address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  entry->address.sin_port =
      htons(static_cast<std::uint16_t>(service != nullptr ? std::atoi(service) : 0));
  entry->info.ai_family = AF_INET;
  entry->info.ai_socktype = SOCK_STREAM;
  entry->info.ai_addrlen = sizeof(entry->address);
  entry->info.ai_addr = reinterpret_cast<sockaddr*>(&entry->address);
  *found = &entry->info;
  return 0;
}
extern "C" __attribute__((visibility("default"))) void freeaddrinfo(addrinfo* info) {
  delete reinterpret_cast<Entry*>(info);
}

namespace stgs::player {
namespace {

std::string url_of(const char* host, const testing::SmallServer& server) {
  return std::string("http://") + host + ":" + std::to_string(server.port()) + "/x.stgs";
}

TEST_CASE("a public name must not have a private address unless that is allowed") {
  const testing::SmallServer server({testing::kFourBytes});
  HttpSettings settings;
  settings.head_bytes = 4;
  const Status refused = open_url(url_of("scenes.example.org", server), settings).status();
  CHECK(refused.code() == StatusCode::kIo);
  CHECK_THAT(refused.message(),
             Catch::Contains("scenes.example.org has the address 127.0.0.1 of a private "
                             "network; set url_allow_private"));
  CHECK(server.requests() == 0);

  settings.allow_private = true;
  CHECK(open_url(url_of("scenes.example.org", server), settings).ok());
}

TEST_CASE("local names may have private addresses") {
  for (const char* host : {"localhost", "nas", "nas.local"}) {
    const testing::SmallServer server({testing::kFourBytes});
    HttpSettings settings;
    settings.head_bytes = 4;
    INFO(host);
    CHECK(open_url(url_of(host, server), settings).ok());
  }
}

TEST_CASE("a redirection to a public name of a private address is refused") {
  const testing::SmallServer target;
  const testing::SmallServer server(
      {"HTTP/1.1 302 Found\r\nLocation: " + url_of("other.example.org", target) +
       "\r\nContent-Length: 0\r\n\r\n"});
  const Status refused = open_url(server.url(), {}).status();
  CHECK_THAT(refused.message(), Catch::Contains("other.example.org has the address 127.0.0.1"));
  CHECK(target.requests() == 0);
}

TEST_CASE("the address of a proxy may be private") {
  const testing::SmallServer proxy({testing::kFourBytes});
  const std::string address = "http://127.0.0.1:" + std::to_string(proxy.port());
  setenv("http_proxy", address.c_str(), 1);
  HttpSettings settings;
  settings.head_bytes = 4;
  const Status through = open_url("http://scenes.example.org/x.stgs", settings).status();
  unsetenv("http_proxy");
  CHECK(through.message() == "");
  CHECK(proxy.requests() == 1);
}

TEST_CASE("a host that needs no proxy may not be private, also at the port of the proxy") {
  const testing::SmallServer server({testing::kFourBytes});
  const std::string port = std::to_string(server.port());
  setenv("http_proxy", ("http://proxy.example.org:" + port).c_str(), 1);
  HttpSettings settings;
  settings.head_bytes = 4;
  for (const char* list : {"scenes.example.org", "a.com, .example.org", "*", "EXAMPLE.org."}) {
    setenv("no_proxy", list, 1);
    const Status direct = open_url(url_of("scenes.example.org", server), settings).status();
    INFO(list);
    CHECK_THAT(direct.message(), Catch::Contains("has the address 127.0.0.1"));
  }
  CHECK(server.requests() == 0);
  setenv("no_proxy", "example.com,10.0.0.0/8", 1);  // others: the name of the proxy is resolved
  CHECK(open_url(url_of("scenes.example.org", server), settings).ok());
  CHECK(server.requests() == 1);
  unsetenv("http_proxy");
  unsetenv("no_proxy");
}

}  // namespace
}  // namespace stgs::player
