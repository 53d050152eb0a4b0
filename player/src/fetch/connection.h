// SPDX-License-Identifier: Apache-2.0
// A connection to an HTTP server, and one attempt at reading a range through it.
#pragma once

#include <curl/curl.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <string>

#include "fetch/deadline.h"
#include "fetch/redirect.h"
#include "stgs/player/source.h"

namespace stgs::player {

// Interval for checking time limits and should_continue(). A stop request wakes a wait at once.
inline constexpr std::chrono::milliseconds kPollInterval{50};

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
  bool unreachable = false;  // the server was not found or refused the connection, within its time
  bool unchanged = false;    // of kDone: the known ETag is still valid, and no body was sent
  std::size_t received = 0;  // bytes, from the beginning of the range
  bool progressed = false;   // many bytes arrived, or not much slower than the minimum rate
  std::uint64_t total = 0;   // file size, from Content-Range; 0: not stated
  std::string validator;     // ETag, else Last-Modified, else empty
  std::string origin;        // of the server that responded (origin_of()); empty: none did
  double retry_after = 0;    // seconds that the server asks to wait
};

// An ETag that a request asks to compare; empty: none.
struct KnownTag {
  std::string etag;
  std::string origin;  // of the server that sent it; others do not receive it
};

// Returns the reason, with the time that the server asks to wait.
std::string reason_with_pause(const Attempt& attempt);

class Reply;

// A keep-alive connection. One thread at a time.
class Connection {
 public:
  // Adds the bytes of the file that arrive to `received`, which outlives the connection.
  static std::unique_ptr<Connection> open(const std::string& url, const HttpSettings& settings,
                                          std::atomic<std::uint64_t>& received);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Requests `out.size()` bytes, at least one, from `offset` on, and follows redirections. With the
  // ETag `known`, if it is not empty, requests them only if the ETag has changed, bypassing caches.
  // Servers of another origin, to which redirections may lead, send them in any case.
  // Ends at the deadline, and once `should_continue`, which may be empty, returns false.
  Attempt get(std::uint64_t offset, std::span<std::uint8_t> out, Deadline& deadline,
              const KnownTag& known = {}, const std::function<bool()>& should_continue = {});

 private:
  Connection(std::string url, const HttpSettings& settings, std::atomic<std::uint64_t>& received);
  // Requests the URL and follows redirections.
  Attempt follow(std::uint64_t offset, std::span<std::uint8_t> out, Deadline& deadline,
                 const KnownTag& known, const std::function<bool()>& should_continue);
  // kUsage if the proxy that the environment states for it is malformed.
  Status set_proxy();
  CURLcode perform(Reply& reply, const Deadline& deadline,
                   const std::function<bool()>& should_continue, bool& stopped);
  // Opens a socket unless the address is private and must not be. libcurl's callback.
  static curl_socket_t open_socket(void* self, curlsocktype purpose, curl_sockaddr* address);

  std::string first_url_, url_;  // of the file; of the current request
  HostRules rules_;
  std::string proxy_;    // of the present request, which decides about addresses; empty: none
  std::string refused_;  // why the last address was refused; empty: it was not
  std::atomic<std::uint64_t>& received_;
  CURLM* multi_ = nullptr;
  CURL* easy_ = nullptr;
  std::stop_token stop_;
  std::chrono::milliseconds stall_, connect_;
};

}  // namespace stgs::player
