// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <random>
#include <vector>

#include "fetch/connection.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

constexpr double kMaxBackoff = 5;      // seconds between attempts, unless the server
constexpr double kMaxRetryAfter = 30;  // asks for a longer wait, up to this
// Interval for checking should_continue() while waiting.
constexpr std::chrono::milliseconds kPollInterval{250};
constexpr std::size_t kMaxComparedHead = 4096;  // bytes by which refresh() recognises the file

class Http final : public HttpSource {
 public:
  Http(std::string url, HttpSettings settings)
      : url_(std::move(url)), name_(display_location(url_)), settings_(std::move(settings)) {
    settings_.max_connections = std::max(settings_.max_connections, 1);
    settings_.max_attempts = std::max(settings_.max_attempts, 1);
  }

  // Reads the first bytes and the size of the file.
  Status open() {
    head_.resize(static_cast<std::size_t>(std::max<std::uint64_t>(settings_.head_bytes, 1)));
    STGS_ASSIGN(const Response response, fetch(0, head_, Check::kNothing));
    head_.resize(response.bytes);
    head_bytes_ = response.bytes;
    state_ = {response.total, response.total, response.validator};
    return {};
  }

  std::uint64_t size() const override { return snapshot().size; }
  void set_finished() override {
    const std::lock_guard lock(mutex_);
    state_.stable_bytes = state_.size;
    state_.is_finished = true;
  }
  const std::string& name() const override { return name_; }

  bool may_grow() const override { return true; }
  Result<Change> refresh(std::uint64_t stable_bytes) override {
    const Snapshot before = snapshot();
    // The file may have changed beyond `stable_bytes`.
    if (stable_bytes < head_bytes_) head_bytes_ = stable_bytes;
    std::vector<std::uint8_t> head(std::clamp<std::size_t>(head_bytes_, 1, kMaxComparedHead));
    STGS_ASSIGN(const Response response,
                fetch(0, head, Check::kNothing, etag_of(before.validator)));
    const std::size_t same = std::min<std::size_t>(head_bytes_, head.size());
    if (!response.unchanged &&
        (response.total < stable_bytes || response.bytes < same ||
         !std::equal(head.begin(), head.begin() + static_cast<std::ptrdiff_t>(same),
                     head_.begin()))) {
      report(TransferEvent::Kind::kReplaced, 0, 0, replaced().message());
      return Change::kReplaced;
    }
    const std::lock_guard lock(mutex_);
    state_.stable_bytes = stable_bytes;
    if (response.unchanged) return Change::kNone;
    state_.validator = response.validator;
    return std::exchange(state_.size, response.total) == response.total ? Change::kNone
                                                                        : Change::kResized;
  }

  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return read_while({}, offset, out);
  }
  Status read_while(const std::function<bool()>& should_continue, std::uint64_t offset,
                    std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    if (out.empty()) return {};
    if (offset + out.size() <= head_bytes_) {
      std::copy_n(head_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
      return {};
    }
    return fetch(offset, out, Check::kSame, {}, should_continue).status();
  }

  TransferStatistics statistics() const override {
    const std::lock_guard lock(mutex_);
    return statistics_;
  }

 private:
  struct Response {
    std::size_t bytes = 0;    // received; fewer than requested at the end of the file
    std::uint64_t total = 0;  // size of the file
    std::string validator;    // ETag, else Last-Modified, else empty
    bool unchanged = false;   // since the given ETag; the other members are not set
  };
  enum class Check {
    kNothing,
    kSame  // fail if the file was replaced
  };

  // Borrows a connection of the source; waits if all are in use.
  class Lease {
   public:
    explicit Lease(const Http& source) : source_(source) {
      std::unique_lock lock(source.mutex_);
      source.freed_.wait(lock, source.settings_.stop, [&] {
        return !source.free_.empty() || source.opened_ < source.settings_.max_connections;
      });
      if (!source.free_.empty()) {
        connection_ = std::move(source.free_.back());
        source.free_.pop_back();
      } else if (source.opened_ < source.settings_.max_connections) {
        connection_ = Connection::open(source.url_, source.settings_);
        if (connection_ != nullptr) ++source.opened_;
      }
    }
    ~Lease() {
      if (connection_ == nullptr) return;
      const std::lock_guard lock(source_.mutex_);
      source_.free_.push_back(std::move(connection_));
      source_.freed_.notify_one();
    }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;
    Connection* get() const { return connection_.get(); }

   private:
    const Http& source_;
    std::unique_ptr<Connection> connection_;
  };

  Status replaced() const {
    return io_error("{}: the file on the server was replaced; open it again", name_);
  }
  Status stopped() const { return runtime_error("{}: reading was stopped", name_); }

  // The state of the file as last observed.
  struct Snapshot {
    std::uint64_t size = 0;
    std::uint64_t stable_bytes = 0;  // prefix that is known not to change
    std::string validator;
    bool is_finished = false;  // all of it is stable, and nothing is added
  };
  Snapshot snapshot() const {
    const std::lock_guard lock(mutex_);
    return state_;
  }
  // Returns the validator if it is an ETag, else an empty string.
  static std::string etag_of(const std::string& validator) {
    return validator.starts_with('"') || validator.starts_with("W/\"") ? validator : "";
  }

  // Returns whether a response is from the file in `snapshot`.
  static bool is_same(const Attempt& attempt, const Snapshot& snapshot) {
    if (attempt.total == 0) return true;  // not stated
    if (attempt.total < snapshot.stable_bytes ||
        (snapshot.is_finished && attempt.total != snapshot.size)) {
      return false;
    }
    const bool is_stable = attempt.total == snapshot.size && attempt.total == snapshot.stable_bytes;
    return !is_stable || attempt.validator == snapshot.validator;
  }

  void report(TransferEvent::Kind kind, std::uint64_t offset, double wait,
              const std::string& message) const {
    if (settings_.on_event) settings_.on_event({kind, offset, wait, message});
  }

  // Reads a range, with retries. If `etag` is not empty and still valid, reads nothing.
  Result<Response> fetch(std::uint64_t offset, std::span<std::uint8_t> out, Check check,
                         const std::string& etag = {},
                         const std::function<bool()>& should_continue = {}) const {
    const Lease lease(*this);
    if (settings_.stop.stop_requested()) return stopped();
    if (lease.get() == nullptr) return runtime_error("{}: libcurl is out of memory", name_);
    std::size_t done = 0;
    for (int failures = 0;;) {
      const Snapshot expected = snapshot();
      const Attempt attempt = lease.get()->get(offset + done, out.subspan(done),
                                               done == 0 ? etag : std::string(), should_continue);
      done += attempt.received;
      count(attempt);
      if (attempt.outcome == Attempt::Outcome::kStopped) return stopped();
      Status failure;
      auto kind = TransferEvent::Kind::kFailed;
      if (check == Check::kSame && !is_same(attempt, expected)) {
        failure = replaced();
        kind = TransferEvent::Kind::kReplaced;
      } else if (attempt.outcome == Attempt::Outcome::kDone ||
                 (attempt.outcome == Attempt::Outcome::kRetryable && done == out.size())) {
        if (check == Check::kNothing || done == out.size()) {
          return Response{done, attempt.total, attempt.validator, attempt.unchanged};
        }
        failure = replaced();
        kind = TransferEvent::Kind::kReplaced;
      } else if (attempt.outcome == Attempt::Outcome::kFatal) {
        failure = {attempt.code, fmt::format("{}: {}", name_, attempt.reason)};
      } else {
        failures = attempt.progressed ? 1 : failures + 1;
        if (failures < settings_.max_attempts) {
          STGS_TRY(wait(offset + done, failures, attempt, should_continue));
          continue;
        }
        failure = io_error("{}: {} (gave up after {} attempt{}) [byte {}]", name_, attempt.reason,
                           failures, failures == 1 ? "" : "s", offset + done);
      }
      report(kind, offset + done, 0, failure.message());
      return failure;
    }
  }

  void count(const Attempt& attempt) const {
    const std::lock_guard lock(mutex_);
    ++statistics_.requests;
    statistics_.bytes += attempt.received;
    if (attempt.outcome == Attempt::Outcome::kRetryable) ++statistics_.retries;
  }

  // Waits before the next attempt: exponential backoff with jitter, at least as long as the server
  // asks for.
  Status wait(std::uint64_t offset, int failures, const Attempt& attempt,
              const std::function<bool()>& should_continue) const {
    std::unique_lock lock(mutex_);
    double seconds =
        std::min(settings_.backoff_seconds * std::ldexp(1.0, failures - 1), kMaxBackoff);
    seconds *= std::uniform_real_distribution<double>(0.75, 1.0)(random_);
    seconds = std::max(seconds, std::min(attempt.retry_after, kMaxRetryAfter));
    lock.unlock();
    report(TransferEvent::Kind::kRetry, offset, seconds,
           fmt::format("{}: {}", name_, attempt.reason));
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    std::mutex none;
    std::unique_lock pause(none);
    std::condition_variable_any never;
    while (std::chrono::steady_clock::now() < end) {
      if (settings_.stop.stop_requested() || (should_continue && !should_continue()))
        return stopped();
      const auto next_check = std::chrono::steady_clock::now() + kPollInterval;
      never.wait_until(pause, settings_.stop, std::min<decltype(end)>(end, next_check),
                       [] { return false; });
    }
    return settings_.stop.stop_requested() ? stopped() : Status();
  }

  std::string url_, name_;
  HttpSettings settings_;
  std::vector<std::uint8_t> head_;             // the first bytes of the file
  std::atomic<std::uint64_t> head_bytes_ = 0;  // how many of these are known to be valid

  mutable std::mutex mutex_;  // guards the following members
  Snapshot state_;
  mutable std::condition_variable_any freed_;
  mutable std::vector<std::unique_ptr<Connection>> free_;
  mutable int opened_ = 0;
  mutable TransferStatistics statistics_;
  mutable std::minstd_rand random_{std::random_device{}()};
};

}  // namespace

bool is_http_built() {
  return true;
}

Result<std::unique_ptr<HttpSource>> open_url(const std::string& url, const HttpSettings& settings) {
  if (!is_url(url)) return usage_error("{}: not an HTTP URL (expected http:// or https://)", url);
  auto source = std::make_unique<Http>(url, settings);
  STGS_TRY(source->open());
  return std::unique_ptr<HttpSource>(std::move(source));
}

}  // namespace stgs::player
