// SPDX-License-Identifier: Apache-2.0
// Opening a URL whose server name is not resolved.
#include <netdb.h>

#include <atomic>
#include <chrono>
#include <future>

#include "catch.h"
#include "stgs/player/source.h"

namespace {

std::atomic<bool> requested{false}, released{false};

}  // namespace

// Replaces the C library's function for libcurl, and blocks until released. Exported by the
// program, whose symbols are hidden otherwise.
extern "C" __attribute__((visibility("default"))) int getaddrinfo(const char*, const char*,
                                                                  const addrinfo*, addrinfo**) {
  requested = true;
  requested.notify_all();
  released.wait(false);
  return EAI_AGAIN;
}

namespace stgs::player {

TEST_CASE("a stop request ends opening while the server's name is looked up") {
  std::stop_source stop;
  HttpSettings settings;
  settings.stop = stop.get_token();
  auto opening = std::async(std::launch::async, [settings] {
    return open_location("http://slow.example/scene.stgs", settings).ok();
  });
  requested.wait(false);
  stop.request_stop();
  CHECK(opening.wait_for(std::chrono::seconds(20)) == std::future_status::ready);
  released = true;
  released.notify_all();
  CHECK_FALSE(opening.get());
}

}  // namespace stgs::player
