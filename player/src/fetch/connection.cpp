// SPDX-License-Identifier: Apache-2.0
#include "fetch/connection.h"

#include <sys/socket.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "fetch/address.h"
#include "fetch/proxy.h"
#include "fetch/reply.h"

namespace stgs::player {
namespace {

constexpr double kMinStall = 0.1;  // seconds
constexpr double kMinSpeed = 100;  // bytes per second; slower transfers count as stalled
// An attempt that brings so many bytes has made progress, however slow it was.
constexpr std::size_t kProgressBytes = 64 << 10;

void start_curl() {
  static std::once_flag once;
  std::call_once(once, [] { curl_global_init(CURL_GLOBAL_DEFAULT); });
}

std::chrono::milliseconds milliseconds(double seconds) {
  return std::chrono::milliseconds(std::max(1L, std::lround(std::min(seconds, 1e6) * 1e3)));
}

struct FreeHeaders {
  void operator()(curl_slist* headers) const { curl_slist_free_all(headers); }
};
using Headers = std::unique_ptr<curl_slist, FreeHeaders>;

// Returns headers that request a body of `url` only if the ETag differs from `known`; null if that
// is empty or from another server.
Headers headers_if_changed(const KnownTag& known, const std::string& url) {
  if (known.etag.empty() || known.origin != origin_of(url)) return nullptr;
  Headers headers(curl_slist_append(nullptr, ("If-None-Match: " + known.etag).c_str()));
  if (headers != nullptr) curl_slist_append(headers.get(), "Cache-Control: no-cache");
  return headers;
}

// Returns whether an attempt has brought so much that the failures before it do not count: many
// bytes, or at least a second's worth at the minimum rate, and no slower.
bool is_progress(std::size_t received, double seconds, const Deadline& deadline) {
  const double expected = deadline.min_bytes_per_second() * std::max(1.0, seconds);
  return received >= kProgressBytes || static_cast<double>(received) >= expected;
}

}  // namespace

std::string reason_with_pause(const Attempt& attempt) {
  if (attempt.retry_after <= 0) return attempt.reason;
  return fmt::format("{} and asks to wait {:.0f} s", attempt.reason, attempt.retry_after);
}

Connection::Connection(std::string url, const HttpSettings& settings,
                       std::atomic<std::uint64_t>& received)
    : first_url_(std::move(url)),
      rules_(first_url_, settings.allow_private),
      received_(received),
      stop_(settings.stop),
      stall_(milliseconds(std::max(settings.stall_seconds, kMinStall))),
      connect_(milliseconds(settings.connect_seconds)) {}

std::unique_ptr<Connection> Connection::open(const std::string& url, const HttpSettings& settings,
                                             std::atomic<std::uint64_t>& received) {
  start_curl();
  auto self = std::unique_ptr<Connection>(new Connection(url, settings, received));
  self->multi_ = curl_multi_init();
  self->easy_ = curl_easy_init();
  CURL* easy = self->easy_;
  if (easy == nullptr || self->multi_ == nullptr) return nullptr;
  curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(easy, CURLOPT_FOLLOWLOCATION, 0L);
  curl_easy_setopt(easy, CURLOPT_USERAGENT, "stgs");
  curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
#if LIBCURL_VERSION_NUM >= 0x075700
  curl_easy_setopt(easy, CURLOPT_QUICK_EXIT, 1L);  // a stop does not wait for name resolution
#endif
  curl_easy_setopt(easy, CURLOPT_TCP_KEEPALIVE, 1L);
  curl_easy_setopt(easy, CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(self->connect_.count()));
  curl_easy_setopt(easy, CURLOPT_OPENSOCKETFUNCTION, open_socket);
  curl_easy_setopt(easy, CURLOPT_OPENSOCKETDATA, self.get());
  return self;
}

Connection::~Connection() {
  if (easy_ != nullptr) curl_easy_cleanup(easy_);
  if (multi_ != nullptr) curl_multi_cleanup(multi_);
}

curl_socket_t Connection::open_socket(void* self, curlsocktype, curl_sockaddr* address) {
  auto& connection = *static_cast<Connection*>(self);
  const std::string host = host_of(connection.url_);
  if (is_private(address->addr) && !connection.rules_.may_be_private(host) &&
      connection.proxy_.empty()) {
    connection.refused_ = private_address_refused(host, address_text(address->addr));
    return CURL_SOCKET_BAD;
  }
  return socket(address->family, address->socktype | SOCK_CLOEXEC, address->protocol);
}

// Runs the transfer. A stop request wakes it. Stalls are timed here, because the speed limit of
// libcurl applies to an average over several seconds. The easy handle is attached to the multi
// handle only during the call; the connection stays open.
CURLcode Connection::perform(Reply& reply, const Deadline& deadline,
                             const std::function<bool()>& should_continue, bool& stopped) {
  using std::chrono::ceil, std::chrono::milliseconds;
  CURLM* const multi = multi_;
  const std::stop_callback wake(stop_, [multi] { curl_multi_wakeup(multi); });
  CURLcode result = CURLE_FAILED_INIT;
  if (curl_multi_add_handle(multi_, easy_) != CURLM_OK) return result;
  for (int running = 1; running > 0 && !stopped;) {
    CURLMcode code = curl_multi_perform(multi_, &running);
    // libcurl enforces a separate timeout for connecting.
    const auto limit = reply.is_connected() ? stall_ : stall_ + connect_;
    const auto left = ceil<milliseconds>(reply.last_progress() + limit - Deadline::Clock::now());
    const auto until_deadline =
        ceil<milliseconds>(std::chrono::duration<double>(deadline.remaining()));
    if (running > 0 && (left.count() <= 0 || until_deadline.count() <= 0)) {
      reply.set_error(left.count() > 0
                          ? reply.summary(deadline.elapsed())
                          : fmt::format("received {} data for {:g} s",
                                        reply.has_trickled() ? "almost no" : "no",
                                        std::chrono::duration<double>(stall_).count()));
      result = CURLE_OPERATION_TIMEDOUT;
      break;
    }
    if (code == CURLM_OK && running > 0) {
      const auto wait = std::min({left, until_deadline, kPollInterval});
      code = curl_multi_poll(multi_, nullptr, 0, static_cast<int>(wait.count()), nullptr);
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

// Sets the proxy of the current request.
Status Connection::set_proxy() {
  STGS_ASSIGN(const Proxy proxy, parse_proxy(proxy_of(url_)));
  const auto text = [](const std::optional<std::string>& value) {
    return value ? value->c_str() : nullptr;
  };
  proxy_ = proxy.url;
  curl_easy_setopt(easy_, CURLOPT_PROXY, proxy_.c_str());  // "": none
  curl_easy_setopt(easy_, CURLOPT_NOPROXY, "");            // proxy_of() has decided
  curl_easy_setopt(easy_, CURLOPT_PROXYUSERNAME, text(proxy.user));
  curl_easy_setopt(easy_, CURLOPT_PROXYPASSWORD, text(proxy.password));
  return {};
}

Attempt Connection::follow(std::uint64_t offset, std::span<std::uint8_t> out, Deadline& deadline,
                           const KnownTag& known, const std::function<bool()>& should_continue) {
  const auto min_progress = static_cast<std::size_t>(
      std::max(1.0, kMinSpeed * std::chrono::duration<double>(stall_).count()));
  url_ = first_url_;
  int responses = 0;
  for (int redirects = 0;; ++redirects) {
    Reply reply(easy_, offset, out, min_progress, responses, deadline, received_);
    curl_easy_setopt(easy_, CURLOPT_URL, url_.c_str());
    if (const Status status = set_proxy(); !status.ok()) {
      Attempt attempt;
      attempt.code = status.code();
      attempt.reason = status.message();
      return attempt;
    }
    const Headers headers = headers_if_changed(known, url_);
    curl_easy_setopt(easy_, CURLOPT_HTTPHEADER, headers.get());
    refused_.clear();
    bool stopped = stop_.stop_requested();
    const CURLcode result =
        stopped ? CURLE_ABORTED_BY_CALLBACK : perform(reply, deadline, should_continue, stopped);
    curl_easy_setopt(easy_, CURLOPT_HTTPHEADER, nullptr);
    responses = reply.responses();
    const bool is_redirect = !stopped && reply.is_redirect(result);
    if (is_redirect && redirects < kMaxRedirects) {
      Result<std::string> target = redirect_target(url_, reply.location());
      Status refusal = target.status();
      if (refusal.ok()) refusal = rules_.check_target(*target);
      if (refusal.ok()) {
        url_ = std::move(target).value();
        continue;
      }
      reply.reject(refusal.message());
    } else if (is_redirect) {
      reply.reject(fmt::format("the server redirects more than {} times", kMaxRedirects));
    } else if (result == CURLE_COULDNT_CONNECT && !refused_.empty()) {
      reply.reject(refused_);
    }
    Attempt attempt;
    reply.judge(result, headers != nullptr, attempt);
    if (reply.responses() > 0) attempt.origin = origin_of(url_);
    if (stopped) attempt.outcome = Attempt::Outcome::kStopped;
    return attempt;
  }
}

Attempt Connection::get(std::uint64_t offset, std::span<std::uint8_t> out, Deadline& deadline,
                        const KnownTag& known, const std::function<bool()>& should_continue) {
  const double begin = deadline.elapsed();
  const std::string range = fmt::format("{}-{}", offset, offset + out.size() - 1);
  curl_easy_setopt(easy_, CURLOPT_RANGE, range.c_str());
  Attempt attempt = follow(offset, out, deadline, known, should_continue);
  attempt.progressed = is_progress(attempt.received, deadline.elapsed() - begin, deadline);
  curl_off_t after = 0;
  if (curl_easy_getinfo(easy_, CURLINFO_RETRY_AFTER, &after) == CURLE_OK) {
    attempt.retry_after = static_cast<double>(after);
  }
  return attempt;
}

}  // namespace stgs::player
