// SPDX-License-Identifier: Apache-2.0
#include "fetch/connection.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <mutex>
#include <optional>
#include <string_view>

namespace stgs::player {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kMinStall = 0.1;  // seconds
constexpr double kMinSpeed = 100;  // bytes per second; slower transfers count as stalled
// Interval for checking timeouts and should_continue(). A stop request wakes the transfer at once.
constexpr int kPollMilliseconds = 250;

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

bool same_name(std::string_view a, std::string_view b) {
  const auto lower = [](char c) { return std::tolower(static_cast<unsigned char>(c)); };
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [&](char x, char y) { return lower(x) == lower(y); });
}

// Consumes a number at the front of `text`.
std::optional<std::uint64_t> take_number(std::string_view& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{}) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return value;
}

// Consumes `token` at the front of `text`, if it is there.
bool take(std::string_view& text, std::string_view token) {
  if (!text.starts_with(token)) return false;
  text.remove_prefix(token.size());
  return true;
}

// The Content-Range header: "bytes FIRST-LAST/TOTAL", or "bytes */TOTAL" if the range does not
// exist.
struct ContentRange {
  std::optional<std::uint64_t> first, last, total;
};

ContentRange parse_content_range(std::string_view text) {
  ContentRange range;
  if (!take(text, "bytes")) return range;
  text = trimmed(text);
  if (!take(text, "*")) {
    range.first = take_number(text);
    if (!range.first || !take(text, "-")) return {};
    range.last = take_number(text);
    if (!range.last) return {};
  }
  if (take(text, "/")) range.total = take_number(text);
  return range;
}

// Returns whether an HTTP status reports a temporary error.
bool is_temporary(long status) {
  return status == 408 || status == 425 || status == 429 || (status >= 500 && status != 501);
}

// Returns whether a retry would fail with the same error.
bool is_fatal(CURLcode code) {
  switch (code) {
    case CURLE_UNSUPPORTED_PROTOCOL:
    case CURLE_URL_MALFORMAT:
    case CURLE_NOT_BUILT_IN:
    case CURLE_OUT_OF_MEMORY:
    case CURLE_TOO_MANY_REDIRECTS:
    case CURLE_PEER_FAILED_VERIFICATION:
    case CURLE_SSL_CACERT_BADFILE:
    case CURLE_SSL_CERTPROBLEM:
    case CURLE_WRITE_ERROR:
      return true;
    default:
      return false;
  }
}

void start_curl() {
  static std::once_flag once;
  std::call_once(once, [] { curl_global_init(CURL_GLOBAL_DEFAULT); });
}

long milliseconds(double seconds) {
  return std::max(1L, std::lround(std::min(seconds, 1e6) * 1e3));
}

struct FreeHeaders {
  void operator()(curl_slist* headers) const { curl_slist_free_all(headers); }
};
using Headers = std::unique_ptr<curl_slist, FreeHeaders>;

// Returns headers that request a body only if the ETag differs from `known`; null if that is empty.
Headers headers_if_changed(const std::string& known) {
  if (known.empty()) return nullptr;
  Headers headers(curl_slist_append(nullptr, ("If-None-Match: " + known).c_str()));
  if (headers != nullptr) curl_slist_append(headers.get(), "Cache-Control: no-cache");
  return headers;
}

}  // namespace

// The response as it arrives. Headers are reset by each response of a chain of redirections.
struct Connection::Reply {
  CURL* easy = nullptr;
  std::uint64_t offset = 0;
  std::span<std::uint8_t> out;
  std::size_t received = 0;
  ContentRange range;
  std::string etag, modified, encoding;
  std::string rejection;  // why the body is rejected; empty: it is not
  StatusCode code = StatusCode::kIo;
  bool connected = false;                          // to the server of the current request
  Clock::time_point last_progress = Clock::now();  // when it connected, or data last arrived
  std::size_t min_progress = 1;                    // bytes of the body that count as progress
  std::size_t since_progress = 0;                  // bytes of the body since then
  char error[CURL_ERROR_SIZE] = {};

  // Sets the outcome, the reason and the code of a request that was not stopped. `conditional`: it
  // asked for a file that has changed.
  void judge(CURLcode result, bool conditional, Attempt& attempt) const;
  long status() const {
    long value = 0;
    curl_easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &value);
    return value;
  }

  void header(std::string_view line) {
    if (line.starts_with("HTTP/")) {
      connected = status() / 100 != 3;  // a redirection connects again
      range = {};
      etag.clear();
      modified.clear();
      encoding.clear();
      return;
    }
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) return;
    const std::string_view name = line.substr(0, colon), value = trimmed(line.substr(colon + 1));
    if (same_name(name, "content-range")) range = parse_content_range(value);
    if (same_name(name, "etag")) etag = value;
    if (same_name(name, "last-modified")) modified = value;
    if (same_name(name, "content-encoding")) encoding = value;
  }

  // Returns whether the body is the requested range.
  bool accepts() {
    if (status() == 200) {
      rejection =
          "the server does not support byte ranges, which reading a scene requires; download the "
          "file first, or use a server that supports them, such as nginx";
      code = StatusCode::kUnsupported;
    } else if (!encoding.empty() && !same_name(encoding, "identity")) {
      rejection = fmt::format(
          "the server applies the content encoding '{}' to byte ranges; disable it for this file",
          encoding);
      code = StatusCode::kUnsupported;
    } else if (!range.first || *range.first != offset) {
      rejection = "the server returned a different byte range than requested";
    }
    return rejection.empty();
  }

  void note_progress() {
    last_progress = Clock::now();
    since_progress = 0;
  }

  // Returns false to end the attempt.
  bool body(const char* bytes, std::size_t count) {
    since_progress += count;
    if (since_progress >= min_progress) note_progress();
    if (status() != 206 && status() != 200) return true;  // an error page
    if (received == 0 && !accepts()) return false;
    if (count > out.size() - received) {
      rejection = "the server sent more data than requested";
      return false;
    }
    std::memcpy(out.data() + received, bytes, count);
    received += count;
    return true;
  }

  // Called before each request, including those of a chain of redirections.
  static int on_connected(void* reply, char*, char*, int, int) {
    static_cast<Reply*>(reply)->connected = true;
    static_cast<Reply*>(reply)->note_progress();
    return CURL_PREREQFUNC_OK;
  }
  static std::size_t on_header(char* bytes, std::size_t size, std::size_t count, void* reply) {
    static_cast<Reply*>(reply)->note_progress();
    static_cast<Reply*>(reply)->header({bytes, size * count});
    return size * count;
  }
  static std::size_t on_body(char* bytes, std::size_t size, std::size_t count, void* reply) {
    return static_cast<Reply*>(reply)->body(bytes, size * count) ? size * count : 0;
  }
};

std::unique_ptr<Connection> Connection::open(const std::string& url, const HttpSettings& settings) {
  start_curl();
  auto self = std::unique_ptr<Connection>(new Connection);
  self->multi_ = curl_multi_init();
  self->easy_ = curl_easy_init();
  self->stop_ = settings.stop;
  CURL* easy = self->easy_;
  if (easy == nullptr || self->multi_ == nullptr) return nullptr;
  self->stall_ =
      std::chrono::milliseconds(milliseconds(std::max(settings.stall_seconds, kMinStall)));
  self->connect_ = std::chrono::milliseconds(milliseconds(settings.connect_seconds));
  curl_easy_setopt(easy, CURLOPT_URL, url.c_str());
  curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  const bool is_https = same_name(std::string_view(url).substr(0, 6), "https:");
  curl_easy_setopt(easy, CURLOPT_REDIR_PROTOCOLS_STR, is_https ? "https" : "http,https");
  curl_easy_setopt(easy, CURLOPT_FOLLOWLOCATION, 1L);
  curl_easy_setopt(easy, CURLOPT_MAXREDIRS, 5L);
  curl_easy_setopt(easy, CURLOPT_USERAGENT, "stgs");
  curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
#if LIBCURL_VERSION_NUM >= 0x075700
  curl_easy_setopt(easy, CURLOPT_QUICK_EXIT, 1L);  // a stop does not wait for name resolution
#endif
  curl_easy_setopt(easy, CURLOPT_TCP_KEEPALIVE, 1L);
  curl_easy_setopt(easy, CURLOPT_CONNECTTIMEOUT_MS, milliseconds(settings.connect_seconds));
  curl_easy_setopt(easy, CURLOPT_PREREQFUNCTION, Reply::on_connected);
  curl_easy_setopt(easy, CURLOPT_HEADERFUNCTION, Reply::on_header);
  curl_easy_setopt(easy, CURLOPT_WRITEFUNCTION, Reply::on_body);
  return self;
}

Connection::~Connection() {
  if (easy_ != nullptr) curl_easy_cleanup(easy_);
  if (multi_ != nullptr) curl_multi_cleanup(multi_);
}

// Runs the transfer. A stop request wakes it. Stalls are timed here, because the speed limit of
// libcurl applies to an average over several seconds. The easy handle is attached to the multi
// handle only during the call; the connection stays open.
CURLcode Connection::perform(Reply& reply, const std::function<bool()>& should_continue,
                             bool& stopped) {
  CURLM* const multi = multi_;
  const std::stop_callback wake(stop_, [multi] { curl_multi_wakeup(multi); });
  CURLcode result = CURLE_FAILED_INIT;
  if (curl_multi_add_handle(multi_, easy_) != CURLM_OK) return result;
  for (int running = 1; running > 0 && !stopped;) {
    CURLMcode code = curl_multi_perform(multi_, &running);
    // libcurl enforces a separate timeout for connecting.
    const auto limit = reply.connected ? stall_ : stall_ + connect_;
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(reply.last_progress + limit - Clock::now());
    if (running > 0 && left.count() <= 0) {
      fmt::format_to_n(reply.error, CURL_ERROR_SIZE - 1, "received {} data for {:g} s",
                       reply.since_progress > 0 ? "almost no" : "no",
                       std::chrono::duration<double>(stall_).count());
      result = CURLE_OPERATION_TIMEDOUT;
      break;
    }
    if (code == CURLM_OK && running > 0) {
      const auto wait = std::min<std::int64_t>(left.count(), kPollMilliseconds);
      code = curl_multi_poll(multi_, nullptr, 0, static_cast<int>(wait), nullptr);
    }
    if (code != CURLM_OK) break;
    stopped = running > 0 && (stop_.stop_requested() || (should_continue && !should_continue()));
  }
  int left = 0;
  while (const CURLMsg* message = curl_multi_info_read(multi_, &left)) {
    if (message->msg == CURLMSG_DONE) result = message->data.result;
  }
  curl_multi_remove_handle(multi_, easy_);
  return result;
}

void Connection::Reply::judge(CURLcode result, bool conditional, Attempt& attempt) const {
  const long http = status();
  const std::uint64_t expected =
      attempt.total > offset ? std::min<std::uint64_t>(out.size(), attempt.total - offset) : 0;
  if (!rejection.empty()) {
    attempt.reason = rejection;
    attempt.code = code;
  } else if (result != CURLE_OK && http < 400) {
    attempt.reason = error[0] != 0 ? error : curl_easy_strerror(result);
    if (!is_fatal(result)) attempt.outcome = Attempt::Outcome::kRetryable;
  } else if (http == 304 && conditional) {
    attempt.outcome = Attempt::Outcome::kDone;
    attempt.unchanged = true;
  } else if (http == 206 || http == 416) {
    if (http == 206 && attempt.total == 0) {
      attempt.reason = "the server does not state the size of the file";
      attempt.code = StatusCode::kUnsupported;
    } else if (received < expected) {
      attempt.outcome = Attempt::Outcome::kRetryable;
      attempt.reason = "the server sent less data than requested";
    } else {
      attempt.outcome = Attempt::Outcome::kDone;
    }
  } else {
    attempt.reason = fmt::format("the server responded with status {}", http);
    if (http == 404 || http == 410) attempt.reason += ": the file does not exist";
    if (http == 401 || http == 403) attempt.reason += ": access denied";
    if (is_temporary(http)) attempt.outcome = Attempt::Outcome::kRetryable;
  }
}

Attempt Connection::get(std::uint64_t offset, std::span<std::uint8_t> out, const std::string& known,
                        const std::function<bool()>& should_continue) {
  Reply reply;
  reply.easy = easy_;
  reply.offset = offset;
  reply.out = out;
  reply.min_progress = static_cast<std::size_t>(
      std::max(1.0, kMinSpeed * std::chrono::duration<double>(stall_).count()));
  const std::string range = fmt::format("{}-{}", offset, offset + out.size() - 1);
  curl_easy_setopt(easy_, CURLOPT_RANGE, range.c_str());
  curl_easy_setopt(easy_, CURLOPT_PREREQDATA, &reply);
  curl_easy_setopt(easy_, CURLOPT_HEADERDATA, &reply);
  curl_easy_setopt(easy_, CURLOPT_WRITEDATA, &reply);
  curl_easy_setopt(easy_, CURLOPT_ERRORBUFFER, reply.error);
  const Headers headers = headers_if_changed(known);
  curl_easy_setopt(easy_, CURLOPT_HTTPHEADER, headers.get());
  bool stopped = stop_.stop_requested();
  const CURLcode result =
      stopped ? CURLE_ABORTED_BY_CALLBACK : perform(reply, should_continue, stopped);
  curl_easy_setopt(easy_, CURLOPT_HTTPHEADER, nullptr);
  curl_easy_setopt(easy_, CURLOPT_ERRORBUFFER, nullptr);

  Attempt attempt;
  attempt.received = reply.received;
  const bool has_stalled = result == CURLE_OPERATION_TIMEDOUT;
  attempt.progressed = reply.received > (has_stalled ? reply.since_progress : 0);
  attempt.total = reply.range.total.value_or(0);
  attempt.validator = reply.etag.empty() ? reply.modified : reply.etag;
  curl_off_t after = 0;
  if (curl_easy_getinfo(easy_, CURLINFO_RETRY_AFTER, &after) == CURLE_OK) {
    attempt.retry_after = static_cast<double>(after);
  }
  if (stopped) {
    attempt.outcome = Attempt::Outcome::kStopped;
  } else {
    reply.judge(result, headers != nullptr, attempt);
  }
  return attempt;
}

}  // namespace stgs::player
