// SPDX-License-Identifier: Apache-2.0
// Hosts to which a server may redirect, and URLs in messages.
#include <arpa/inet.h>
#include <netinet/in.h>

#include <cstring>

#include "catch.h"
#include "fetch/address.h"
#include "fetch/redirect.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

bool is_private_text(const char* text) {
  sockaddr_storage storage{};
  sockaddr_in v4{};
  sockaddr_in6 v6{};
  if (inet_pton(AF_INET, text, &v4.sin_addr) == 1) {
    v4.sin_family = AF_INET;
    std::memcpy(&storage, &v4, sizeof(v4));
  } else {
    REQUIRE(inet_pton(AF_INET6, text, &v6.sin6_addr) == 1);
    v6.sin6_family = AF_INET6;
    std::memcpy(&storage, &v6, sizeof(v6));
  }
  const auto& address = reinterpret_cast<const sockaddr&>(storage);
  CHECK(address_text(address) == text);
  return is_private(address);
}

TEST_CASE("addresses of private networks are recognised") {
  for (const char* text : {"0.0.0.0",
                           "0.255.255.255",
                           "10.0.0.0",
                           "10.255.255.255",
                           "100.64.0.0",
                           "100.127.255.255",
                           "127.0.0.1",
                           "127.255.255.255",
                           "169.254.0.1",
                           "169.254.169.254",
                           "172.16.0.0",
                           "172.31.255.255",
                           "192.0.0.1",
                           "192.168.0.0",
                           "192.168.255.255",
                           "198.18.0.1",
                           "198.19.255.255",
                           "224.0.0.1",
                           "239.1.1.1",
                           "240.0.0.1",
                           "255.255.255.255",
                           "::",
                           "::1",
                           "::ffff:10.0.0.1",
                           "::ffff:127.0.0.1",
                           "64:ff9b::7f00:1",
                           "64:ff9b:1::1",
                           "2002:7f00:1::",
                           "2002:c0a8:101::1",
                           "2001:0:808:808::80ff:fffe",
                           "fc00::1",
                           "fdff::1",
                           "fe80::1",
                           "febf::1",
                           "fec0::1",
                           "ff02::1",
                           "100::1",
                           "192.0.2.0",
                           "192.0.2.255",
                           "192.31.196.1",
                           "192.52.193.1",
                           "192.88.99.1",
                           "192.175.48.1",
                           "198.51.100.0",
                           "203.0.113.255",
                           "::ffff:192.0.2.1",
                           "2002:c058:6301::1",
                           "2001:0:7f00:1::f7f7:f7f7",
                           "2001:1::1",
                           "2001:2::1",
                           "2001:1ff::1",
                           "2001:db8::1",
                           "2606:4700::5efe:a00:1",
                           "2606:4700::200:5efe:7f00:1",
                           "2620:4f:8000::1",
                           "3fff::1",
                           "3fff:fff::1",
                           "5f00::1"}) {
    INFO(text);
    CHECK(is_private_text(text));
  }
}

TEST_CASE("addresses of the Internet are not private") {
  for (const char* text : {"1.1.1.1",
                           "9.255.255.255",
                           "11.0.0.0",
                           "100.63.255.255",
                           "100.128.0.0",
                           "126.0.0.1",
                           "128.0.0.1",
                           "169.253.0.1",
                           "169.255.0.1",
                           "172.15.255.255",
                           "172.32.0.0",
                           "192.0.1.0",
                           "192.167.255.255",
                           "192.169.0.0",
                           "198.17.0.1",
                           "198.20.0.0",
                           "223.255.255.255",
                           "::ffff:1.1.1.1",
                           "64:ff9b::101:101",
                           "2001:4860:4860::8888",
                           "2002:101:101::1",
                           "2606:4700::1111",
                           "3fff:1000::1",
                           "2001:200::1",
                           "2001:db9::1",
                           "2620:4f:8001::1",
                           "2606:4700::200:5efe:808:808",
                           "2606:4700::300:5efe:a00:1",
                           "192.0.3.0",
                           "192.88.98.255",
                           "192.88.100.0",
                           "198.51.99.255",
                           "203.0.114.0"}) {
    INFO(text);
    CHECK_FALSE(is_private_text(text));
  }
}

TEST_CASE("names of local networks are recognised") {
  for (const char* host :
       {"localhost", "LOCALHOST", "nas", "nas.", "printer.local", "a.b.Local.", "x.localhost"}) {
    INFO(host);
    CHECK(is_local_name(host));
    CHECK(is_private_host(host));
  }
  for (const char* host : {"example.org", "local.example.org", "notlocal.org", ""}) {
    INFO(host);
    CHECK_FALSE(is_local_name(host));
    CHECK_FALSE(is_private_host(host));
  }
  CHECK(is_private_host("10.1.2.3"));
  CHECK(is_private_host("[::1]"));
  CHECK_FALSE(is_private_host("1.1.1.1"));
  CHECK_FALSE(is_private_host("[2606:4700::1111]"));
}

TEST_CASE("a redirection is resolved against the URL that it is from") {
  const std::string from = "https://u:p@example.org/a/b.stgs?k=1#f";
  const struct {
    const char *location, *target;
  } cases[] = {{"c.stgs", "https://u:p@example.org/a/c.stgs"},
               {"/c.stgs", "https://u:p@example.org/c.stgs"},
               {"?k=2", "https://u:p@example.org/a/b.stgs?k=2"},
               {"//cdn.example.org/c", "https://cdn.example.org/c"},
               {"https://cdn.example.org/c#x", "https://cdn.example.org/c"},
               {"https://me:secret@cdn.example.org/c", "https://cdn.example.org/c"},
               {"https://me:secret@example.org/c", "https://u:p@example.org/c"},
               {"https://EXAMPLE.org:443/c", "https://u:p@EXAMPLE.org:443/c"},
               {"https://example.org:444/c", "https://example.org:444/c"}};
  for (const auto& [location, target] : cases) {
    INFO(location);
    const auto resolved = redirect_target(from, location);
    REQUIRE(resolved.ok());
    CHECK(*resolved == target);
  }
  // A URL that gets encrypted is another origin.
  CHECK(*redirect_target("http://u:p@example.org/a", "https://example.org/a") ==
        "https://example.org/a");
}

TEST_CASE("redirections to other schemes and from https to http are refused") {
  const auto message = [](const char* from, const char* location) {
    const auto target = redirect_target(from, location);
    CHECK(target.status().code() == StatusCode::kIo);
    return target.status().message();
  };
  CHECK_THAT(message("https://example.org/a", "http://example.org/a"),
             Catch::Contains("from https to http"));
  CHECK_THAT(message("http://example.org/a", "file:///etc/hostname"),
             Catch::Contains("scheme file"));
  CHECK_THAT(message("http://example.org/a", "ftp://example.org/a"), Catch::Contains("scheme ftp"));
  CHECK_THAT(message("http://example.org/a", "gopher2://x/"), Catch::Contains("unsupported URL"));
  CHECK_THAT(message("http://example.org/a", "http://:80:80/"), Catch::Contains("malformed"));
  CHECK_THAT(message("http://example.org/a", ""), Catch::Contains("malformed"));
}

TEST_CASE("only the host that the user gave may be in a private network") {
  const HostRules public_url("http://example.org/a", false), local("http://127.0.0.1:80/a", false),
      named("http://nas/a", false), allowed("http://example.org/a", true);
  CHECK_FALSE(public_url.may_be_private("example.org"));
  CHECK(local.may_be_private("127.0.0.1"));
  CHECK_FALSE(local.may_be_private("localhost"));
  CHECK(named.may_be_private("NAS."));
  CHECK(allowed.may_be_private("10.0.0.1"));

  CHECK(public_url.check_target("http://cdn.example.org/a").ok());
  CHECK(local.check_target("http://127.0.0.1:81/b").ok());
  CHECK(allowed.check_target("http://10.0.0.1/").ok());
  for (const char* target :
       {"http://127.0.0.1/", "http://127.1/", "http://0x7f000001/", "http://[::ffff:127.0.0.1]/",
        "http://localhost/", "http://nas/", "http://169.254.169.254/latest/meta-data"}) {
    INFO(target);
    const Status refused = public_url.check_target(target);
    CHECK(refused.code() == StatusCode::kIo);
    CHECK_THAT(refused.message(), Catch::Contains("set url_allow_private"));
  }
}

TEST_CASE("the names of URLs in messages contain no secrets") {
  const struct {
    const char *location, *shown;
  } cases[] = {
      {"a@b:c.stgs", "a@b:c.stgs"},  // a path
      {"http://h/x.stgs", "http://h/x.stgs"},
      {"http://h:80/x.stgs?key=s#f", "http://h:80/x.stgs"},
      {"http://u@h/x", "http://h/x"},
      {"http://u:secret@h:80/x", "http://h:80/x"},
      {"https://u:se@cret@h/x", "https://h/x"},
      {"http://u:se/cret@h/x", "http://***@h/x"},
      {"http://u@x:se/cret@h/x", "http://***@h/x"},
      {"http://u:12/34@h/x", "http://***@h/x"},
      {"http://u:se?cret@h/x", "http://***@h/x"},
      {"http://u:se#cret@h/x?k", "http://***@h/x"},
      {"http://u:a/b@c/d@h/x", "http://***@h/x"},
      {"http://u:se@/cr:et/@h/x", "http://***@h/x"},
      {"http://u@/se:cret@h/x", "http://***@h/x"},
      {"http://u:s@/x", "http:///x"},
      {"https://cdn.example.org/package@1.2/x.stgs", "https://cdn.example.org/package@1.2/x.stgs"},
      {"https://u:p@cdn.example.org/package@1.2/x.stgs",
       "https://cdn.example.org/package@1.2/x.stgs"},
      {"https://h/x.stgs?mail=me@example.org", "https://h/x.stgs"},
      {"https://h:80/x.stgs?mail=me@example.org", "https://h:80/x.stgs"},
      {"ftp://u:secret@h/x?key=s", "ftp://h/x"},
      {"s3://secret@bucket/x", "s3://bucket/x"},
      {"http:/u:secret@h/x", "http:/h/x"},
      {"http:///u:secret@h/x", "http:///h/x"},
      {"http://u:pass\\word@h/x", "http://h/x"},
      {"http://domain\\u:secret@h/x", "http://h/x"},
      {"http://@\\/:/@h", "http://***@h"},
      {"http://", "http://"}};
  for (const auto& [location, shown] : cases) {
    INFO(location);
    CHECK(display_location(location) == shown);
  }
}

}  // namespace
}  // namespace stgs::player
