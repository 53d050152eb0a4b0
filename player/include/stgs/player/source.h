// SPDX-License-Identifier: Apache-2.0
// Byte sources for scenes: local files, and files behind HTTP.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <string>

#include "stgs/format/byte_source.h"

namespace stgs::player {

// An incident of a transfer. Reported on the thread that reads, possibly by several threads at
// once.
struct TransferEvent {
  enum class Kind {
    kRetry,     // an attempt failed; another one follows
    kFailed,    // the read fails
    kReplaced,  // the read fails: the file was replaced; reads fail until it is opened again
  };
  Kind kind = Kind::kRetry;
  std::uint64_t offset = 0;  // in the file, of the first byte that was not received
  double wait_seconds = 0;   // before the next attempt
  std::string message;
};

// Ranges of HttpSettings::request_seconds and min_bytes_per_second.
inline constexpr double kMinRequestSeconds = 0.1, kMaxRequestSeconds = 1e6;
inline constexpr double kMinBytesPerSecond = 1, kMaxBytesPerSecond = 1e9;

// Settings of an HttpSource.
struct HttpSettings {
  // Limit of one read, all its attempts included, from the time that it has a connection to its
  // last byte: name lookup, connecting, redirections, headers and pauses (also those that the
  // server asks for) count. The limit grows by the time that the bytes of the read take at the
  // minimum rate, so that large reads from a slow server succeed. Before, a read waits for a free
  // connection while the reads that have one receive, together, at least the minimum rate, and then
  // at most request_seconds; a read that fails ends the wait of all. There is no way to have no
  // limit.
  double request_seconds = 60;
  double min_bytes_per_second = 1000;
  // Whether a public host name, or a redirection, may lead to an address of a private network. The
  // host of the URL may be there in any case if it is an address, localhost, a single label or a
  // name below .local, also after redirections. The addresses behind a proxy are not known.
  bool allow_private = false;
  int max_connections = 4;      // open at once and kept alive; further reads wait for one
  double connect_seconds = 10;  // timeout of connecting; then the attempt fails
  // Timeout without data of the body, or with fewer than 100 bytes/s; then the attempt fails.
  // Clamped to at least 0.1.
  double stall_seconds = 10;
  // Consecutive attempts that bring less than 64 KiB, and bring it below the minimum rate, before a
  // read fails.
  int max_attempts = 5;
  double backoff_seconds = 0.2;  // before the second attempt; doubles with each further one, to 5 s
  std::uint64_t head_bytes = 64 << 10;  // of the file, read when it is opened and cached
  std::function<void(const TransferEvent&)> on_event;
  // Makes pending and later reads fail at once (kRuntime).
  std::stop_token stop;
};

// Counts of an HttpSource since it was opened.
struct TransferStatistics {
  std::uint64_t requests = 0;  // answered or not
  std::uint64_t bytes = 0;     // received in response bodies
  std::uint64_t retries = 0;
};

// A file behind a server that supports range requests (RFC 9110, 14). If an attempt fails, the
// bytes received are retained and the next attempt requests the rest. With any server, a read ends
// within a second of HttpSettings::request_seconds, extended as stated there, and within 0.1 s of a
// stop request. (A libcurl without a resolver thread of its own waits for name lookup.)
// After a read has run out of time, reads fail at once for 5 s, or request_seconds if that is less,
// unless one succeeds; after one that failed for another reason than a replaced file, and took
// longer than 0.5 s, for as long as it took, up to 5 s.
//
// Reads fail with kIo if the file
// - is smaller than it was, or than the prefix that refresh() was given, or
// - was replaced by another of the same size (by its ETag, else by its Last-Modified time).
// A file that has grown, unless it is finished, counts as the same file; refresh() checks whether
// its beginning is unchanged. If the server sends ETags, refreshing an unchanged file takes one
// response without a body (RFC 9110, 13.1.2).
class HttpSource final : public ByteSource {
 public:
  class Impl;
  // Used by open_url().
  explicit HttpSource(std::unique_ptr<Impl> impl);
  ~HttpSource() override;

  std::uint64_t size() const override;
  const std::string& name() const override;
  bool may_grow() const override;
  Result<Change> refresh(std::uint64_t stable_bytes) override;
  void set_finished() override;
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override;
  Status read_while(const std::function<bool()>& should_continue, std::uint64_t offset,
                    std::span<std::uint8_t> out) const override;
  // Returns the counts so far. Thread-safe.
  TransferStatistics statistics() const;

 private:
  std::unique_ptr<Impl> impl_;
};

// Returns whether this build can read URLs, which requires libcurl.
bool is_http_built();

// Returns whether `location` begins with http:// or https://.
bool is_url(const std::string& location);

// Returns `location` for use in messages: a URL, of any scheme and with any number of slashes,
// without its userinfo and without its query, which may be a secret. Hides all before an '@' that
// may end a password with a '/', '?' or '#', too
// ("http://***@host").
std::string display_location(const std::string& location);

// Opens a URL and reads its first HttpSettings::head_bytes. Follows up to 5 redirections, but not
// from https to http; uses the proxies that libcurl finds in the environment. Errors: kIo if the
// server does not respond in time, leads to a private network, or the file does not exist;
// kUnsupported if the server does not support ranges; kNotBuilt without libcurl; kUsage if `url` is
// not an HTTP URL or the settings are out of range.
Result<std::unique_ptr<HttpSource>> open_url(const std::string& url,
                                             const HttpSettings& settings = {});

// Opens a path or an HTTP URL. URLs of another scheme fail with kUsage.
Result<std::unique_ptr<ByteSource>> open_location(const std::string& location,
                                                  const HttpSettings& settings = {});

}  // namespace stgs::player
