// SPDX-License-Identifier: Apache-2.0
#include "fetch/reply.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstring>

namespace stgs::player {
namespace {

constexpr auto kTooLarge = static_cast<CURLcode>(100);  // CURLE_TOO_LARGE, since 8.6
constexpr std::string_view kHeadersTooLong = "the headers of the response exceed 64 KiB";

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

// Consumes `token` at the front of `text`, if it is there.
bool take(std::string_view& text, std::string_view token) {
  if (!text.starts_with(token)) return false;
  text.remove_prefix(token.size());
  return true;
}

// Returns the value of an ETag (RFC 9110, 8.8.3) or a Last-Modified header if it has only the
// characters of one: it may be sent back, also by way of proxies. Else an empty text.
std::string_view checked_validator(std::string_view value) {
  constexpr std::size_t kMaxValidator = 1 << 10;
  if (value.size() > kMaxValidator) return {};
  std::string_view opaque = value;
  (void)take(opaque, "W/");
  const bool is_tag = opaque.size() >= 2 && opaque.starts_with('"') && opaque.ends_with('"');
  if (is_tag) opaque = opaque.substr(1, opaque.size() - 2);
  const bool is_valid = std::all_of(opaque.begin(), opaque.end(), [&](char c) {
    const auto code = static_cast<unsigned char>(c);
    if (!is_tag) return code >= 0x20 && code < 0x7F && c != '"';  // a date
    return code > 0x20 && code != 0x7F && c != '"';
  });
  return is_valid ? value : std::string_view();
}

// Consumes a number at the front of `text`.
std::optional<std::uint64_t> take_number(std::string_view& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{}) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return value;
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
    case CURLE_PEER_FAILED_VERIFICATION:
    case CURLE_SSL_CACERT_BADFILE:
    case CURLE_SSL_CERTPROBLEM:
    case CURLE_WRITE_ERROR:
      return true;
    default:
      return false;
  }
}

// Returns whether there is no server at the address: more time does not help.
bool is_unreachable(CURLcode code) {
  return code == CURLE_COULDNT_CONNECT || code == CURLE_COULDNT_RESOLVE_HOST ||
         code == CURLE_COULDNT_RESOLVE_PROXY;
}

}  // namespace

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

Reply::Reply(CURL* easy, std::uint64_t offset, std::span<std::uint8_t> out,
             std::size_t min_progress, int responses, Deadline& deadline,
             std::atomic<std::uint64_t>& total_received)
    : easy_(easy),
      offset_(offset),
      out_(out),
      min_progress_(min_progress),
      responses_(responses),
      deadline_(deadline),
      total_received_(total_received) {
  curl_easy_setopt(easy, CURLOPT_PREREQFUNCTION, on_connected);
  curl_easy_setopt(easy, CURLOPT_PREREQDATA, this);
  curl_easy_setopt(easy, CURLOPT_HEADERFUNCTION, on_header);
  curl_easy_setopt(easy, CURLOPT_HEADERDATA, this);
  curl_easy_setopt(easy, CURLOPT_WRITEFUNCTION, on_body);
  curl_easy_setopt(easy, CURLOPT_WRITEDATA, this);
  curl_easy_setopt(easy, CURLOPT_ERRORBUFFER, error_);
}

Reply::~Reply() {
  curl_easy_setopt(easy_, CURLOPT_ERRORBUFFER, nullptr);
}

long Reply::status() const {
  long value = 0;
  curl_easy_getinfo(easy_, CURLINFO_RESPONSE_CODE, &value);
  return value;
}

bool Reply::is_redirect(CURLcode result) const {
  const bool is_complete = result == CURLE_OK || ignored_ > kMaxErrorPage;
  const long code = status();
  return is_complete && rejection_.empty() && !location_.empty() &&
         (code == 301 || code == 302 || code == 303 || code == 307 || code == 308);
}

std::string Reply::summary(double seconds) const {
  if (!connected_) return fmt::format("no connection to the server within {:.1f} s", seconds);
  if (responses_ == 0) return fmt::format("the server did not respond within {:.1f} s", seconds);
  if (received_ == 0 && since_progress_ == 0) {
    return fmt::format("the server sent headers, but no data within {:.1f} s", seconds);
  }
  return fmt::format("the server sent {} byte{} of the file within {:.1f} s", received_,
                     received_ == 1 ? "" : "s", seconds);
}

void Reply::reject(std::string reason, StatusCode code) {
  rejection_ = std::move(reason);
  code_ = code;
}

void Reply::set_error(const std::string& text) {
  const std::size_t count = std::min<std::size_t>(text.size(), CURL_ERROR_SIZE - 1);
  std::memcpy(error_, text.data(), count);
  error_[count] = 0;
}

bool Reply::header(std::string_view line) {
  if (line.starts_with("HTTP/")) {
    header_bytes_ = 0;
    range_ = {};
    etag_.clear();
    modified_.clear();
    encoding_.clear();
    location_.clear();
    if (++responses_ > kMaxResponses) {
      reject(fmt::format("the server sent more than {} responses to a request", kMaxResponses));
      return false;
    }
  }
  header_bytes_ += line.size();
  if (header_bytes_ > kMaxHeaderBytes) {
    reject(std::string(kHeadersTooLong));
    return false;
  }
  header_field(line);
  return true;
}

void Reply::header_field(std::string_view line) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos) return;
  const std::string_view name = line.substr(0, colon), value = trimmed(line.substr(colon + 1));
  if (same_name(name, "content-range")) range_ = parse_content_range(value);
  if (same_name(name, "etag")) etag_ = checked_validator(value);
  if (same_name(name, "last-modified")) modified_ = checked_validator(value);
  if (same_name(name, "content-encoding")) encoding_ = value;
  if (same_name(name, "location")) location_ = value;
}

// Returns whether the body is the requested range.
bool Reply::accepts() {
  if (status() == 200) {
    reject(
        "the server does not support byte ranges, which reading a scene requires; download the "
        "file first, or use a server that supports them, such as nginx",
        StatusCode::kUnsupported);
  } else if (!encoding_.empty() && !same_name(encoding_, "identity")) {
    reject(
        fmt::format("the server applies the content encoding '{}' to byte ranges; disable it for "
                    "this file",
                    encoding_),
        StatusCode::kUnsupported);
  } else if (!range_.first || *range_.first != offset_) {
    reject("the server returned a different byte range than requested");
  }
  return rejection_.empty();
}

void Reply::note_progress() {
  last_progress_ = Clock::now();
  since_progress_ = 0;
}

// Returns false to end the attempt.
bool Reply::body(const char* bytes, std::size_t count) {
  since_progress_ += count;
  if (since_progress_ >= min_progress_) note_progress();
  if (status() != 206 && status() != 200) {  // the page of an error or a redirection
    ignored_ += count;
    return ignored_ <= kMaxErrorPage;
  }
  if (received_ == 0 && !accepts()) return false;
  if (count > out_.size() - received_) {
    reject("the server sent more data than requested");
    return false;
  }
  std::memcpy(out_.data() + received_, bytes, count);
  received_ += count;
  deadline_.add_bytes(count);
  total_received_ += count;
  return true;
}

void Reply::judge(CURLcode result, bool conditional, Attempt& attempt) const {
  const long http = status();
  attempt.received = received_;
  attempt.total = range_.total.value_or(0);
  attempt.validator = etag_.empty() ? modified_ : etag_;
  const std::uint64_t expected =
      attempt.total > offset_ ? std::min<std::uint64_t>(out_.size(), attempt.total - offset_) : 0;
  // libcurl limits a line of the headers by itself.
  const bool has_long_line =
      connected_ && received_ == 0 && (result == CURLE_OUT_OF_MEMORY || result == kTooLarge);
  if (!rejection_.empty() || has_long_line) {
    attempt.reason = has_long_line ? kHeadersTooLong : rejection_;
    attempt.code = code_;
  } else if (result != CURLE_OK && http < 400) {
    attempt.reason = error_[0] != 0 ? error_ : curl_easy_strerror(result);
    attempt.unreachable = is_unreachable(result);
    if (!is_fatal(result)) attempt.outcome = Attempt::Outcome::kRetryable;
  } else if (http == 304 && conditional) {
    attempt.outcome = Attempt::Outcome::kDone;
    attempt.unchanged = true;
  } else if (http == 206 || http == 416) {
    if (http == 206 && attempt.total == 0) {
      attempt.reason = "the server does not state the size of the file";
      attempt.code = StatusCode::kUnsupported;
    } else if (received_ < expected) {
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

// Called before the request is sent.
int Reply::on_connected(void* reply, char*, char*, int, int) {
  static_cast<Reply*>(reply)->connected_ = true;
  static_cast<Reply*>(reply)->note_progress();
  return CURL_PREREQFUNC_OK;
}

std::size_t Reply::on_header(char* bytes, std::size_t size, std::size_t count, void* reply) {
  const std::string_view line(bytes, size * count);
  return static_cast<Reply*>(reply)->header(line) ? line.size() : 0;
}

std::size_t Reply::on_body(char* bytes, std::size_t size, std::size_t count, void* reply) {
  return static_cast<Reply*>(reply)->body(bytes, size * count) ? size * count : 0;
}

}  // namespace stgs::player
