// SPDX-License-Identifier: Apache-2.0
// A connection to an HTTP server, and one attempt at reading a range through it.
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

// The outcome of an attempt.
struct Attempt {
  enum class Outcome {
    kDone,       // all requested bytes arrived, or all up to the end of the file
    kRetryable,  // a network error, or a server error that is temporary
    kFatal,      // a retry would fail the same way
    kStopped,    // by HttpSettings::stop or `should_continue`
  };
  Outcome outcome = Outcome::kFatal;
  StatusCode code = StatusCode::kIo;  // of kFatal
  std::string reason;
  bool unchanged = false;    // of kDone: the known ETag is still valid, and no body was sent
  std::size_t received = 0;  // bytes, from the beginning of the range
  bool progressed = false;   // bytes arrived, and not too slowly to count
  std::uint64_t total = 0;   // file size, from Content-Range; 0: not stated
  std::string validator;     // ETag, else Last-Modified, else empty
  double retry_after = 0;    // seconds that the server asks to wait
};

// A keep-alive connection. One thread at a time.
class Connection {
 public:
  static std::unique_ptr<Connection> open(const std::string& url, const HttpSettings& settings);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Requests `out.size()` bytes, at least one, from `offset` on. With the ETag `known`, if it is
  // not empty, requests them only if the ETag has changed, bypassing caches. Stops once
  // `should_continue`, which may be empty, returns false.
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
