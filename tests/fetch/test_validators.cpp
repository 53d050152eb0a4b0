// SPDX-License-Identifier: Apache-2.0
// The validators of servers, which are sent back: only with the characters that they may have, and
// only to the server that they are from.
#include "catch.h"
#include "small_server.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

using testing::SmallServer;

// The first 4 bytes of a file of 4, with further header lines.
std::string response(const std::string& headers) {
  return "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-3/4\r\nContent-Length: 4\r\n" +
         headers + "\r\nstgs";
}

// Returns the second request of a reader that opens a file and refreshes it.
std::string refreshing(const std::string& headers) {
  const SmallServer server({response(headers), response("")});
  auto source = open_url(server.url());
  REQUIRE(source.ok());
  CHECK((*source)->refresh(4).ok());
  return server.request(1);
}

bool has_tag(const std::string& request) {
  return request.find("If-None-Match") != std::string::npos;
}

TEST_CASE("an ETag is sent back if it has the characters of one") {
  for (const std::string& tag :
       std::vector<std::string>{"\"1\"", "W/\"a-!~\"", "\"\"", "\"\x80\xff\""}) {
    INFO(tag);
    CHECK(refreshing("ETag: " + tag + "\r\n").find("If-None-Match: " + tag + "\r\n") !=
          std::string::npos);
  }
  for (const std::string& tag :
       {std::string("\"x\rX-Inject: yes\r\""), std::string("\"a b\""), std::string("\"a\"b\""),
        std::string("\"a\x7f\""), std::string("\"a\tb\""), std::string("1"), std::string("\""),
        "\"" + std::string(2000, 'a') + "\""}) {
    INFO(tag);
    const std::string request = refreshing("ETag: " + tag + "\r\n");
    CHECK_FALSE(has_tag(request));
    CHECK(request.find("Inject") == std::string::npos);
  }
}

TEST_CASE("an ETag is not sent to another server") {
  const std::string tag = "ETag: \"1\"\r\n";
  const auto redirection = [](const std::string& url) {
    return "HTTP/1.1 302 Found\r\nContent-Length: 0\r\nLocation: " + url + "\r\n\r\n";
  };
  // The second server sends a tag, the third is the target of the next redirection.
  const SmallServer second({response(tag), response(tag)}), third({response("")});
  const SmallServer first(
      {redirection(second.url()), redirection(second.url()), redirection(third.url())});
  auto source = open_url(first.url());
  REQUIRE(source.ok());
  CHECK((*source)->refresh(4).ok());
  CHECK((*source)->refresh(4).ok());
  CHECK_FALSE(has_tag(first.request(1)));
  CHECK(has_tag(second.request(1)));
  CHECK_FALSE(has_tag(first.request(2)));
  CHECK_FALSE(has_tag(third.request(0)));
}

}  // namespace
}  // namespace stgs::player
