// SPDX-License-Identifier: Apache-2.0
// Where the bytes of a scene come from: a file of this machine, or one behind HTTP.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "stgs/format/byte_source.h"

namespace stgs::player {

// What a transfer met with. Told from the thread that reads, by several threads at once.
struct TransferEvent {
  enum class Kind {
    kRetry,     // a try failed, another follows
    kFailed,    // the read fails
    kReplaced,  // the read fails: the file is another one now, and stays so until it is opened
                // again
  };
  Kind kind = Kind::kRetry;
  std::uint64_t offset = 0;  // in the file, of the first byte that has not come
  double wait_seconds = 0;   // before the next try
  std::string message;       // what went wrong
};

struct HttpSettings {
  int max_connections = 4;      // at once at most, kept alive; reads beyond wait for one
  double connect_seconds = 10;  // to a connection, else the try has failed
  // Without a byte, or with less than 100 a second of them, after which the try has failed; less
  // than 0.1 counts as that.
  double stall_seconds = 10;
  int max_attempts = 5;          // in a row that bring nothing, or too slowly; then the read fails
  double backoff_seconds = 0.2;  // before the second try; twice as long before each next, up to 5 s
  std::uint64_t head_bytes = 64 << 10;  // asked for when it is opened, and kept
  std::function<void(const TransferEvent&)> on_event;
  // Ends reads that are under way, and all later ones, at once (kRuntime).
  std::stop_token stop;
};

struct TransferStatistics {
  std::uint64_t requests = 0;  // answered or not
  std::uint64_t bytes = 0;     // of bodies, that arrived
  std::uint64_t retries = 0;
};

// A file behind a server that answers byte ranges (RFC 9110, 14). What has come of a range when a
// try fails is kept, and the next try asks for the rest. Reads tell (kIo) where the file has become
// smaller than it was, or than what refresh() was told to stay, or another of the same size (by its
// ETag, else its time); one that has grown, if it is not finished, is taken for the same, longer,
// and refresh() looks whether its beginning is. Where the server gives an ETag, refresh() of what
// has not changed is one answer without a body (RFC 9110, 13.1.2).
class HttpSource : public ByteSource {
 public:
  virtual TransferStatistics statistics() const = 0;
};

// Whether URLs can be read in this build, which takes libcurl.
bool is_http_built();

// Whether it begins with http:// or https://.
bool is_url(const std::string& place);

// The place for messages: a URL without who asks, and without a query, which may be a key.
std::string display_location(const std::string& place);

// Errors: kIo where there is no answer or no such file, kUnsupported where the server does not
// answer ranges, kNotBuilt without libcurl. Follows redirections; proxies are those of the
// environment, as libcurl reads it.
Result<std::unique_ptr<HttpSource>> open_url(const std::string& url,
                                             const HttpSettings& settings = {});

// open_url or open_file. Another kind of URL is an error (kUsage).
Result<std::unique_ptr<ByteSource>> open_location(const std::string& place,
                                                  const HttpSettings& settings = {});

}  // namespace stgs::player
