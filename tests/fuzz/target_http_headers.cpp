// SPDX-License-Identifier: Apache-2.0
// Data of a server: complete responses, as libcurl passes them to a reply, Content-Range
// headers, redirections, hosts and addresses, and URLs in messages. The first byte of an input is
// the kind.
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <memory>
#include <string>
#include <string_view>

#include "fetch/address.h"
#include "fetch/redirect.h"
#include "fetch/reply.h"
#include "fuzz_target.h"
#include "stgs/player/source.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::player;

namespace {

enum Kind : std::uint8_t { kResponse, kContentRange, kRedirect, kHost, kAddress, kShown, kKinds };

constexpr std::size_t kMaxResponse = 64 << 10;  // fits into the buffer of a socket
constexpr std::uint64_t kOffset = 10;
constexpr std::string_view kSecret = "s3cRet";
constexpr const char* kOrigin = "https://user:s3cRet@example.org:8443/scenes/a.stgs?token=1";

Bytes input_of(Kind kind, std::string_view content) {
  Bytes out = {kind};
  out.insert(out.end(), content.begin(), content.end());
  return out;
}

std::vector<Bytes> seeds() {
  return {
      input_of(kResponse,
               "HTTP/1.1 206 Partial Content\r\nContent-Length: 5\r\nETag: \"a\"\r\n"
               "Content-Range: bytes 10-14/15\r\n\r\nhello"),
      input_of(kResponse,
               "HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 206 OK\r\nContent-Range: bytes "
               "10-17/100\r\nTransfer-Encoding: chunked\r\n\r\n4\r\nabcd\r\n4\r\nefgh\r\n"
               "0\r\n\r\n"),
      input_of(kResponse, "HTTP/1.1 302 Found\r\nLocation: /b.stgs\r\nContent-Length: 0\r\n\r\n"),
      input_of(kResponse,
               "HTTP/1.1 416 No\r\nContent-Range: bytes */5\r\nContent-Length: 2\r\n"
               "\r\nno"),
      input_of(kResponse, "HTTP/1.1 503 Busy\r\nRetry-After: 7\r\nContent-Encoding: gzip\r\n\r\n"),
      input_of(kResponse,
               "HTTP/1.0 200 OK\r\nLast-Modified: Mon, 01 Jan 2024 00:00:00 GMT\r\n\r\nx"),
      input_of(kContentRange, "bytes 0-99/100"),
      input_of(kContentRange, "bytes */18446744073709551615"),
      input_of(kRedirect, "../b.stgs#x"),
      input_of(kRedirect, "https://other:pw@192.168.0.1:99/x?y"),
      input_of(kRedirect, "//[::ffff:10.0.0.1]/"),
      input_of(kRedirect, "http://example.org/"),
      input_of(kHost, "[fe80::1%25eth0]"),
      input_of(kHost, "printer.local."),
      input_of(kHost, "127.0.0.1"),
      input_of(kAddress, std::string("\x0a\0\0\1", 4)),
      input_of(kAddress, std::string("\0\0\0\0\0\0\0\0\0\0\xff\xff\x7f\0\0\1", 16)),
      input_of(kShown, "user:p/w?d#@host/a?b=c#d"),
      input_of(kShown, "a@b@c:80/d@e"),
  };
}

// Copies of the texts; the bodies are limited.
std::uint64_t memory(View input) {
  return 32 * input.size() + (64 << 10);
}

// A request that is answered by the bytes of the input.
class Exchange {
 public:
  explicit Exchange(std::string_view response) : easy_(curl_easy_init(), &curl_easy_cleanup) {
    require(easy_ != nullptr && ::socketpair(AF_UNIX, SOCK_STREAM, 0, ends_) == 0,
            "a request can be made");
    const std::string_view sent = response.substr(0, kMaxResponse);
    require(::send(ends_[1], sent.data(), sent.size(), MSG_NOSIGNAL) ==
                static_cast<ssize_t>(sent.size()),
            "the response can be sent");
    ::shutdown(ends_[1], SHUT_WR);
    CURL* const easy = easy_.get();
    curl_easy_setopt(easy, CURLOPT_URL, kUrl);
    curl_easy_setopt(easy, CURLOPT_RANGE, "10-17");
    curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(easy, CURLOPT_PROXY, "");
    curl_easy_setopt(easy, CURLOPT_TIMEOUT_MS, 5000L);
    curl_easy_setopt(easy, CURLOPT_OPENSOCKETFUNCTION, open_socket);
    curl_easy_setopt(easy, CURLOPT_OPENSOCKETDATA, this);
    curl_easy_setopt(easy, CURLOPT_SOCKOPTFUNCTION, is_connected);
  }
  ~Exchange() {
    ::close(ends_[1]);
    if (!is_taken_) ::close(ends_[0]);
  }
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  static constexpr const char* kUrl = "http://192.0.2.1/a.stgs";
  CURL* easy() const { return easy_.get(); }

 private:
  // libcurl closes the socket that it is given.
  static curl_socket_t open_socket(void* self, curlsocktype, curl_sockaddr*) {
    auto& exchange = *static_cast<Exchange*>(self);
    if (exchange.is_taken_) return CURL_SOCKET_BAD;
    exchange.is_taken_ = true;
    return exchange.ends_[0];
  }
  static int is_connected(void*, curl_socket_t, curlsocktype) {
    return CURL_SOCKOPT_ALREADY_CONNECTED;
  }

  int ends_[2];
  bool is_taken_ = false;
  std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> easy_;
};

void check_redirect(const std::string& from, const std::string& location) {
  const auto target = redirect_target(from, location);
  if (!target.ok()) {
    require(target.status().code() == StatusCode::kIo && !target.status().message().empty(),
            "a refused redirection has a reason");
    return;
  }
  require(is_url(*target), "a redirection leads to an HTTP URL");
  require(!from.starts_with("https:") || target->starts_with("https:"),
          "a redirection never leaves https");
  require(target->find('#') == std::string::npos, "a target has no fragment");
  const bool is_same_server = target->find("example.org:8443") != std::string::npos;
  require(is_same_server || target->find(kSecret) == std::string::npos ||
              location.find(kSecret) != std::string::npos,
          "another server does not get the password");
  const auto again = redirect_target(from, *target);
  require(again.ok() && *again == *target, "a target is complete");
  const HostRules rules(from, false);
  if (rules.check_target(*target).ok()) {
    require(!is_private_host(host_of(*target)) || rules.may_be_private(host_of(*target)),
            "an accepted target is not private");
  }
}

void check_response(std::string_view response) {
  Exchange exchange(response);
  std::uint8_t out[8];
  Deadline deadline{HttpSettings{}};
  std::atomic<std::uint64_t> total{0};
  Reply reply(exchange.easy(), kOffset, out, 4, 0, deadline, total);
  const CURLcode result = curl_easy_perform(exchange.easy());
  Attempt attempt;
  reply.judge(result, true, attempt);
  require(attempt.received <= sizeof out && attempt.received == total,
          "no more bytes are received than requested");
  require(reply.responses() <= kMaxResponses + 1, "the number of responses is limited");
  require(attempt.outcome == Attempt::Outcome::kDone || !attempt.reason.empty(),
          "a failed attempt has a reason");
  const bool is_complete = attempt.outcome == Attempt::Outcome::kDone && !attempt.unchanged;
  require(!is_complete || reply.status() != 206 || attempt.received == sizeof out ||
              kOffset + attempt.received == attempt.total,
          "a complete range has all its bytes");
  if (reply.is_redirect(result)) check_redirect(Exchange::kUrl, reply.location());
  (void)reply.summary(deadline.elapsed());
}

void check_content_range(std::string_view text) {
  const ContentRange range = parse_content_range(text);
  require(range.first.has_value() == range.last.has_value(), "a range has both ends or none");
  if (!range.first) return;
  std::string written = "bytes " + std::to_string(*range.first) + "-" + std::to_string(*range.last);
  if (range.total) written += "/" + std::to_string(*range.total);
  const ContentRange again = parse_content_range(written);
  require(again.first == range.first && again.last == range.last && again.total == range.total,
          "a range round-trips");
}

void check_host(const std::string& host) {
  const bool address = is_address(host), local = is_local_name(host);
  require(!(address && local), "a host is not both an address and a name");
  require(!local || is_private_host(host), "a local name is private");
  require(is_same_host(host, host), "a host is the same as itself");
  const HostRules rules("http://" + host + "/", false);
  (void)rules.may_be_private(host);
}

void check_address(View bytes) {
  sockaddr_storage storage{};
  sockaddr_in v4{};
  sockaddr_in6 v6{};
  if (bytes.size() >= sizeof v6.sin6_addr) {
    v6.sin6_family = AF_INET6;
    std::memcpy(&v6.sin6_addr, bytes.data(), sizeof v6.sin6_addr);
    std::memcpy(&storage, &v6, sizeof v6);
  } else {
    v4.sin_family = AF_INET;
    std::memcpy(&v4.sin_addr, bytes.data(), std::min(bytes.size(), sizeof v4.sin_addr));
    std::memcpy(&storage, &v4, sizeof v4);
  }
  const auto& address = reinterpret_cast<const sockaddr&>(storage);
  const std::string text = address_text(address);
  require(is_address(text), "an address is an address as text");
  require(is_private_host(text) == is_private(address), "the text of an address is as private");
  const bool is_v4 = address.sa_family == AF_INET;
  require(!is_v4 || is_private_host("[::ffff:" + text + "]") == is_private(address),
          "a mapped address is as private");
}

void check_shown(const std::string& text) {
  for (const std::string& url : {"http://" + text, "HTTPS://" + text}) {
    const std::string shown = display_location(url);
    require(is_url(shown), "a shown URL is one");
    require(shown.find_first_of("?#") == std::string::npos, "a shown URL has no query");
    require(display_location(shown).size() <= shown.size(), "a shown URL can be shown");
  }
  // A password of any bytes but a port's.
  if (text.find_first_of("?#") != std::string::npos) return;
  const std::string url = "http://user:" + std::string(kSecret) + text + "@host/a.stgs?b";
  require(display_location(url).find(kSecret) == std::string::npos, "a password is not shown");
}

}  // namespace

const Target stgs::fuzz::kTarget{"http_headers", seeds, nullptr, nullptr, nullptr, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const bool is_ready = curl_global_init(CURL_GLOBAL_DEFAULT) == CURLE_OK;
  require(is_ready, "libcurl can be used");
  if (size == 0) return 0;
  const std::string text(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0] % kKinds) {
    case kResponse:
      check_response(text);
      break;
    case kContentRange:
      check_content_range(text);
      break;
    case kRedirect:
      check_redirect(kOrigin, text);
      break;
    case kHost:
      check_host(text);
      break;
    case kAddress:
      check_address({data + 1, size - 1});
      break;
    default:
      check_shown(text);
  }
  return 0;
}
