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

constexpr double kLeastStall = 0.1;  // seconds
constexpr double kLeastSpeed = 100;  // bytes a second: what comes more slowly counts as silence
// Between looks at timeouts, and at whether what comes is still wanted; a stop wakes it at once.
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

// Takes a number from the front.
std::optional<std::uint64_t> take_number(std::string_view& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{}) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return value;
}

bool take(std::string_view& text, std::string_view what) {
  if (!text.starts_with(what)) return false;
  text.remove_prefix(what.size());
  return true;
}

// Of a whole answer: "bytes FIRST-LAST/TOTAL", or "bytes */TOTAL" where the range is not there.
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

bool is_for_now(long status) {
  return status == 408 || status == 425 || status == 429 || (status >= 500 && status != 501);
}

// Errors that another try is not going to meet with differently.
bool is_hopeless(CURLcode code) {
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

// Those that ask for an answer only if the ETag is not `known`; null where that is none.
Headers headers_if_changed(const std::string& known) {
  if (known.empty()) return nullptr;
  Headers headers(curl_slist_append(nullptr, ("If-None-Match: " + known).c_str()));
  if (headers != nullptr) curl_slist_append(headers.get(), "Cache-Control: no-cache");
  return headers;
}

}  // namespace

// What arrives of an answer. Headers begin anew with each answer of a chain of redirections.
struct Connection::Reply {
  CURL* easy = nullptr;
  std::uint64_t offset = 0;
  std::span<std::uint8_t> out;
  std::size_t received = 0;
  ContentRange range;
  std::string etag, modified, encoding;
  std::string refused;  // why the body is not taken
  StatusCode code = StatusCode::kIo;
  bool connected = false;                  // to who is asked now
  Clock::time_point heard = Clock::now();  // when that was, or something of it had come last
  std::size_t least = 1;                   // bytes of the body that are something
  std::size_t unheard = 0;                 // bytes that have come since
  char error[CURL_ERROR_SIZE] = {};

  long status() const {
    long value = 0;
    curl_easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &value);
    return value;
  }

  void header(std::string_view line) {
    if (line.starts_with("HTTP/")) {
      connected = status() / 100 != 3;  // elsewhere next
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

  // Whether the body is the range that was asked for.
  bool accepts() {
    if (status() == 200) {
      refused =
          "the server sends whole files only, and a scene is read in byte ranges; fetch the file "
          "first, or serve it by one that answers ranges, as nginx does";
      code = StatusCode::kUnsupported;
    } else if (!encoding.empty() && !same_name(encoding, "identity")) {
      refused = fmt::format("the server encodes ranges ({}), so they are not the file's", encoding);
      code = StatusCode::kUnsupported;
    } else if (!range.first || *range.first != offset) {
      refused = "the server answers with another range than it was asked for";
    }
    return refused.empty();
  }

  void hear() {
    heard = Clock::now();
    unheard = 0;
  }

  // False ends the try.
  bool body(const char* bytes, std::size_t count) {
    unheard += count;
    if (unheard >= least) hear();
    if (status() != 206 && status() != 200) return true;  // a page that tells of an error
    if (received == 0 && !accepts()) return false;
    if (count > out.size() - received) {
      refused = "the server sends more than it was asked for";
      return false;
    }
    std::memcpy(out.data() + received, bytes, count);
    received += count;
    return true;
  }

  // Before each request, of a chain of redirections too.
  static int on_connected(void* reply, char*, char*, int, int) {
    static_cast<Reply*>(reply)->connected = true;
    static_cast<Reply*>(reply)->hear();
    return CURL_PREREQFUNC_OK;
  }
  static std::size_t on_header(char* bytes, std::size_t size, std::size_t count, void* reply) {
    static_cast<Reply*>(reply)->hear();
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
      std::chrono::milliseconds(milliseconds(std::max(settings.stall_seconds, kLeastStall)));
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
  curl_easy_setopt(easy, CURLOPT_QUICK_EXIT, 1L);  // a stop waits for no server's name
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

// Runs the transfer; a stop wakes it. Silence is timed here: libcurl's own limit is of a speed that
// it takes the mean of over some seconds. The handles stay together only meanwhile, the connection
// in any case.
CURLcode Connection::perform(Reply& reply, const std::function<bool()>& should_continue,
                             bool& stopped) {
  CURLM* const multi = multi_;
  const std::stop_callback wake(stop_, [multi] { curl_multi_wakeup(multi); });
  CURLcode result = CURLE_FAILED_INIT;
  if (curl_multi_add_handle(multi_, easy_) != CURLM_OK) return result;
  for (int running = 1; running > 0 && !stopped;) {
    CURLMcode code = curl_multi_perform(multi_, &running);
    // Connecting has a time of its own, which libcurl keeps.
    const auto limit = reply.connected ? stall_ : stall_ + connect_;
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(reply.heard + limit - Clock::now());
    if (running > 0 && left.count() <= 0) {
      fmt::format_to_n(reply.error, CURL_ERROR_SIZE - 1, "{} came for {:g} s",
                       reply.unheard > 0 ? "next to nothing" : "nothing",
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

Attempt Connection::get(std::uint64_t offset, std::span<std::uint8_t> out, const std::string& known,
                        const std::function<bool()>& should_continue) {
  Reply reply;
  reply.easy = easy_;
  reply.offset = offset;
  reply.out = out;
  reply.least = static_cast<std::size_t>(
      std::max(1.0, kLeastSpeed * std::chrono::duration<double>(stall_).count()));
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
  const bool was_silent = result == CURLE_OPERATION_TIMEDOUT;
  attempt.progressed = reply.received > (was_silent ? reply.unheard : 0);
  attempt.total = reply.range.total.value_or(0);
  attempt.validator = reply.etag.empty() ? reply.modified : reply.etag;
  curl_off_t after = 0;
  if (curl_easy_getinfo(easy_, CURLINFO_RETRY_AFTER, &after) == CURLE_OK) {
    attempt.retry_after = static_cast<double>(after);
  }
  const long status = reply.status();
  const std::uint64_t there =
      attempt.total > offset ? std::min<std::uint64_t>(out.size(), attempt.total - offset) : 0;
  if (stopped) {
    attempt.outcome = Attempt::Outcome::kStopped;
  } else if (!reply.refused.empty()) {
    attempt.reason = reply.refused;
    attempt.code = reply.code;
  } else if (result != CURLE_OK && status < 400) {
    attempt.reason = reply.error[0] != 0 ? reply.error : curl_easy_strerror(result);
    if (!is_hopeless(result)) attempt.outcome = Attempt::Outcome::kAgain;
  } else if (status == 304 && headers != nullptr) {
    attempt.outcome = Attempt::Outcome::kDone;
    attempt.unchanged = true;
  } else if (status == 206 || status == 416) {
    if (status == 206 && attempt.total == 0) {
      attempt.reason = "the server does not tell how large the file is";
      attempt.code = StatusCode::kUnsupported;
    } else if (reply.received < there) {
      attempt.outcome = Attempt::Outcome::kAgain;
      attempt.reason = "the server sends less than it was asked for";
    } else {
      attempt.outcome = Attempt::Outcome::kDone;
    }
  } else {
    attempt.reason = fmt::format("the server answers {}", status);
    if (status == 404 || status == 410) attempt.reason += ": there is no such file";
    if (status == 401 || status == 403) attempt.reason += ": it does not let this be read";
    if (is_for_now(status)) attempt.outcome = Attempt::Outcome::kAgain;
  }
  return attempt;
}

}  // namespace stgs::player
