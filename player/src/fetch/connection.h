// SPDX-License-Identifier: Apache-2.0
// One connection to an HTTP server, and one try at a range over it.
#pragma once

#include <curl/curl.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <string>

#include "stgs/player/source.h"

namespace stgs::player {

// What became of a try.
struct Attempt {
  enum class Outcome {
    kDone,      // all bytes that were asked for, or up to the file's end
    kAgain,     // the network, or a server that says that it is its fault or for now
    kHopeless,  // would fail again
    kStopped,
  };
  Outcome outcome = Outcome::kHopeless;
  StatusCode code = StatusCode::kIo;  // of what is hopeless
  std::string reason;
  bool unchanged = false;    // of kDone: nothing was sent, the validator is the known one
  std::size_t received = 0;  // bytes of the range, from its first
  bool progressed = false;   // they came, and not too slowly to count
  std::uint64_t total = 0;   // the file's size by Content-Range; 0: not told
  std::string validator;     // ETag, else Last-Modified, else empty
  double retry_after = 0;    // seconds that the server asks for
};

// Kept alive between tries. One thread at a time.
class Connection {
 public:
  static std::unique_ptr<Connection> open(const std::string& url, const HttpSettings& settings);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Asks for `out.size()` bytes, at least one, from `offset` on; with the ETag `known`, where it is
  // not empty, only if it is another now, and past caches that may hold what was. Stopped where
  // `should_continue`, which may be empty, answers false.
  Attempt get(std::uint64_t offset, std::span<std::uint8_t> out, const std::string& known = {},
              const std::function<bool()>& should_continue = {});

 private:
  struct Reply;

  Connection() = default;
  CURLcode perform(Reply& reply, const std::function<bool()>& should_continue, bool& stopped);

  CURLM* multi_ = nullptr;
  CURL* easy_ = nullptr;
  std::stop_token stop_;
  std::chrono::milliseconds stall_{0}, connect_{0};
};

}  // namespace stgs::player
