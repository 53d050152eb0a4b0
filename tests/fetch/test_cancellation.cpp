// SPDX-License-Identifier: Apache-2.0
// The delay with which reads from URLs end when they are stopped. The promise is 100 ms; the tests
// allow more, for busy machines, and print the delay.
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <future>
#include <vector>

#include "catch.h"
#include "small_server.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

using testing::kFourBytes;
using testing::SmallServer;
using Clock = std::chrono::steady_clock;

constexpr double kAllowed = 0.5;  // seconds

// Starts `read`, stops it once `may_stop` returns, and returns how long it then took, seconds.
double seconds_to_stop(const char* name, const std::function<bool()>& read,
                       const std::function<void()>& may_stop, const std::function<void()>& stop) {
  auto reading = std::async(std::launch::async, read);
  may_stop();
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  CHECK(reading.wait_for(std::chrono::seconds(0)) == std::future_status::timeout);
  const auto begin = Clock::now();
  stop();
  CHECK_FALSE(reading.get());
  const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  std::printf("stopped %s after %.1f ms\n", name, 1e3 * seconds);
  return seconds;
}

// Measures stopping the opening of a URL.
double seconds_to_stop_opening(const char* name, const SmallServer& server) {
  std::stop_source stop;
  HttpSettings settings;
  settings.stop = stop.get_token();
  return seconds_to_stop(
      name, [&] { return open_url(server.url(), settings).ok(); },
      [&] { server.wait_for_requests(1); }, [&] { stop.request_stop(); });
}

TEST_CASE("a stop request ends the wait for a response within 100 ms") {
  const SmallServer server;
  CHECK(seconds_to_stop_opening("the wait for a response", server) < kAllowed);
}

TEST_CASE("a stop request ends the pause that a server asks for within 100 ms") {
  const SmallServer server({"HTTP/1.1 503 Busy\r\nRetry-After: 20\r\nContent-Length: 0\r\n\r\n"});
  CHECK(seconds_to_stop_opening("a pause", server) < kAllowed);
}

// A source with one connection, which a read uses without end.
class BusySource {
 public:
  BusySource() {
    HttpSettings settings;
    settings.head_bytes = 4;
    settings.max_connections = 1;
    settings.stop = stop_.get_token();
    source_ = std::move(open_url(server_.url(), settings)).value();
    first_ = std::async(std::launch::async, [this] { return read(); });
    server_.wait_for_requests(2);
  }
  void stop() { stop_.request_stop(); }
  bool read(const std::function<bool()>& should_continue = {}) const {
    std::vector<std::uint8_t> out(1000);
    return source_->read_while(should_continue, 100, out).ok();
  }
  ~BusySource() { stop(); }

 private:
  const SmallServer server_{{kFourBytes}};
  std::stop_source stop_;
  std::unique_ptr<HttpSource> source_;
  std::future<bool> first_;
};

TEST_CASE("a stop request ends the wait for a free connection within 100 ms") {
  BusySource source;
  CHECK(seconds_to_stop(
            "the wait for a connection", [&] { return source.read(); }, [] {},
            [&] { source.stop(); }) < kAllowed);
}

TEST_CASE("a read that is not wanted any more ends within 100 ms") {
  BusySource source;
  std::atomic<bool> is_wanted = true;
  const auto ask = [&] { return is_wanted.load(); };
  CHECK(seconds_to_stop(
            "a read that waits for a connection", [&] { return source.read(ask); }, [] {},
            [&] { is_wanted = false; }) < kAllowed);

  const SmallServer server({kFourBytes});
  HttpSettings settings;
  settings.head_bytes = 4;
  const auto idle = std::move(open_url(server.url(), settings)).value();
  is_wanted = true;
  std::vector<std::uint8_t> out(1000);
  CHECK(seconds_to_stop(
            "a read that waits for a response",
            [&] { return idle->read_while(ask, 100, out).ok(); },
            [&] { server.wait_for_requests(2); }, [&] { is_wanted = false; }) < kAllowed);
}

TEST_CASE("a read fails if no connection is free in time") {
  const SmallServer server({kFourBytes});
  HttpSettings settings;
  settings.head_bytes = 4;
  settings.max_connections = 1;
  settings.request_seconds = 0.3;
  const auto source = std::move(open_url(server.url(), settings)).value();
  const auto read = [&] {
    std::vector<std::uint8_t> out(1000);
    return source->read(100, out);
  };
  auto first = std::async(std::launch::async, read);
  server.wait_for_requests(2);
  const Status second = read();
  CHECK(second.code() == StatusCode::kIo);
  // The first read may have ended just before, so that the second has the connection.
  CHECK_THAT(second.message(), Catch::Contains("gave up after 0."));
  CHECK_THAT(first.get().message(), Catch::Contains("the server did not respond within 0."));
}

// The beginning of a response with `count` bytes of a file of 900 kB.
std::string response_of(std::uint64_t offset, std::size_t count, std::size_t sent) {
  return fmt::format(
             "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes {}-{}/900000\r\n"
             "Content-Length: {}\r\n\r\n",
             offset, offset + count - 1, count) +
         std::string(sent, 'x');
}

TEST_CASE("bytes of other reads do not extend the deadline of a read") {
  // The first read is complete. The second, which has waited for it, is sent 10 bytes.
  const SmallServer server(
      {response_of(0, 4, 4), response_of(100, 100000, 100000), response_of(200000, 100000, 10)});
  HttpSettings settings;
  settings.head_bytes = 4;
  settings.max_connections = 1;
  settings.request_seconds = 1;
  settings.min_bytes_per_second = 10000;  // 100 kB: 10 s
  const auto source = std::move(open_url(server.url(), settings)).value();
  std::atomic<bool> is_asked = false, may_end = false;
  auto first = std::async(std::launch::async, [&] {
    std::vector<std::uint8_t> out(100000);
    // Holds the connection until the second read waits for it.
    const auto hold = [&] {
      is_asked = true;
      while (!may_end) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      return true;
    };
    return source->read_while(hold, 100, out);
  });
  while (!is_asked && first.wait_for(std::chrono::milliseconds(1)) != std::future_status::ready) {
  }
  const auto begin = Clock::now();
  auto second = std::async(std::launch::async, [&] {
    std::vector<std::uint8_t> out(100000);
    return source->read(200000, out);
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  may_end = true;
  CHECK(first.get().message() == "");
  CHECK_THAT(second.get().message(), Catch::Contains("sent 10 bytes of the file within 1."));
  CHECK(std::chrono::duration<double>(Clock::now() - begin).count() < 3);
}

TEST_CASE("a read that fails ends the wait of the others for its connection") {
  const SmallServer server({response_of(0, 4, 4), response_of(100, 100000, 60000)});  // 60 kB: 6 s
  HttpSettings settings;
  settings.head_bytes = 4;
  settings.max_connections = 1;
  settings.max_attempts = 1;
  settings.stall_seconds = 1;
  settings.request_seconds = 5;
  settings.min_bytes_per_second = 10000;
  const auto source = std::move(open_url(server.url(), settings)).value();
  const auto read = [&](std::uint64_t offset) {
    std::vector<std::uint8_t> out(100000);
    return source->read(offset, out);
  };
  auto first = std::async(std::launch::async, read, 100);
  server.wait_for_requests(2);
  std::vector<std::future<Status>> others;
  for (int k = 0; k < 3; ++k) others.push_back(std::async(std::launch::async, read, 200000));
  const Status failure = first.get();
  CHECK_THAT(failure.message(), Catch::Contains("gave up after 1 attempt"));
  const auto begin = Clock::now();
  for (auto& other : others) CHECK(other.get().message() == failure.message());
  CHECK(std::chrono::duration<double>(Clock::now() - begin).count() < kAllowed);
  CHECK(server.requests() == 2);
}

TEST_CASE("settings without a limit are refused") {
  for (const double seconds : {0.0, -1.0, 1e7, HUGE_VAL, std::nan("")}) {
    HttpSettings settings;
    settings.request_seconds = seconds;
    CHECK(open_url("http://127.0.0.1:1/", settings).status().code() == StatusCode::kUsage);
    settings = {};
    settings.min_bytes_per_second = seconds > 1 ? 10 * seconds * seconds : seconds;
    CHECK(open_url("http://127.0.0.1:1/", settings).status().code() == StatusCode::kUsage);
  }
}

}  // namespace
}  // namespace stgs::player
