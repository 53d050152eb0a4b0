// SPDX-License-Identifier: Apache-2.0
// A server whose name is not told.
#include <netdb.h>

#include <atomic>
#include <chrono>
#include <future>

#include "catch.h"
#include "stgs/player/source.h"

namespace {

std::atomic<bool> asked{false}, told{false};

}  // namespace

// In place of the C library's, for libcurl.
extern "C" int getaddrinfo(const char*, const char*, const addrinfo*, addrinfo**) {
  asked = true;
  asked.notify_all();
  told.wait(false);
  return EAI_AGAIN;
}

namespace stgs::player {

TEST_CASE("opening is broken off while the name of the server is looked for") {
  std::stop_source stop;
  HttpSettings settings;
  settings.stop = stop.get_token();
  auto opening = std::async(std::launch::async, [settings] {
    return open_location("http://slow.example/scene.stgs", settings).ok();
  });
  asked.wait(false);
  stop.request_stop();
  CHECK(opening.wait_for(std::chrono::seconds(20)) == std::future_status::ready);
  told = true;
  told.notify_all();
  CHECK_FALSE(opening.get());
}

}  // namespace stgs::player
