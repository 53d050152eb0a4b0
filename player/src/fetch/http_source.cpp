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

constexpr double kLongestWait = 5;        // seconds between tries of our own choice
constexpr double kLongestWaitAsked = 30;  // and where the server asks for it
// Between looks at whether what is waited for is still wanted.
constexpr std::chrono::milliseconds kLook{250};
constexpr std::size_t kHeadCompared = 4096;  // bytes that tell whether a file is still the same

class Http final : public HttpSource {
 public:
  Http(std::string url, HttpSettings settings)
      : url_(std::move(url)), name_(display_location(url_)), settings_(std::move(settings)) {
    settings_.max_connections = std::max(settings_.max_connections, 1);
    settings_.max_attempts = std::max(settings_.max_attempts, 1);
  }

  // The first bytes, which tell the size.
  Status open() {
    head_.resize(static_cast<std::size_t>(std::max<std::uint64_t>(settings_.head_bytes, 1)));
    STGS_ASSIGN(const Seen seen, fetch(0, head_, Check::kNothing));
    head_.resize(seen.bytes);
    head_bytes_ = seen.bytes;
    known_ = {seen.total, seen.total, seen.validator};
    return {};
  }

  std::uint64_t size() const override { return known().size; }
  void set_finished() override {
    const std::lock_guard lock(mutex_);
    known_.kept = known_.size;
    known_.is_finished = true;
  }
  const std::string& name() const override { return name_; }

  bool may_grow() const override { return true; }
  Result<Change> refresh(std::uint64_t kept) override {
    const Known before = known();
    // What is beyond `kept` may be another now.
    if (kept < head_bytes_) head_bytes_ = kept;
    std::vector<std::uint8_t> head(std::clamp<std::size_t>(head_bytes_, 1, kHeadCompared));
    STGS_ASSIGN(const Seen seen, fetch(0, head, Check::kNothing, etag_of(before.validator)));
    const std::size_t same = std::min<std::size_t>(head_bytes_, head.size());
    if (!seen.unchanged &&
        (seen.total < kept || seen.bytes < same ||
         !std::equal(head.begin(), head.begin() + static_cast<std::ptrdiff_t>(same),
                     head_.begin()))) {
      tell(TransferEvent::Kind::kReplaced, 0, 0, replaced().message());
      return Change::kReplaced;
    }
    const std::lock_guard lock(mutex_);
    known_.kept = kept;
    if (seen.unchanged) return Change::kNone;
    known_.validator = seen.validator;
    return std::exchange(known_.size, seen.total) == seen.total ? Change::kNone : Change::kResized;
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
  // What an answer told of the file.
  struct Seen {
    std::size_t bytes = 0;  // of those asked for: fewer at the file's end
    std::uint64_t total = 0;
    std::string validator;
    bool unchanged = false;  // nothing else was told
  };
  enum class Check { kNothing, kSame };

  // A connection of this source while it lives; waits where all are in use.
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
    return io_error("{}: the file on the server is another one now; open it again", name_);
  }
  Status stopped() const { return runtime_error("{}: reading was stopped", name_); }

  // What is known of the file.
  struct Known {
    std::uint64_t size = 0;
    std::uint64_t kept = 0;  // of these bytes, how many are known to stay
    std::string validator;
    bool is_finished = false;  // all of them, and no more come
  };
  Known known() const {
    const std::lock_guard lock(mutex_);
    return known_;
  }
  // A validator that is an ETag, else nothing.
  static std::string etag_of(const std::string& validator) {
    return validator.starts_with('"') || validator.starts_with("W/\"") ? validator : "";
  }

  // Whether an answer is of the file that was known when it was asked for.
  static bool is_same(const Attempt& attempt, const Known& known) {
    if (attempt.total == 0) return true;  // it did not say
    if (attempt.total < known.kept || (known.is_finished && attempt.total != known.size)) {
      return false;
    }
    const bool all_stays = attempt.total == known.size && attempt.total == known.kept;
    return !all_stays || attempt.validator == known.validator;
  }

  void tell(TransferEvent::Kind kind, std::uint64_t offset, double wait,
            const std::string& message) const {
    if (settings_.on_event) settings_.on_event({kind, offset, wait, message});
  }

  // `etag`, where it is not empty: nothing needs to come as long as it is that.
  Result<Seen> fetch(std::uint64_t offset, std::span<std::uint8_t> out, Check check,
                     const std::string& etag = {},
                     const std::function<bool()>& should_continue = {}) const {
    const Lease lease(*this);
    if (settings_.stop.stop_requested()) return stopped();
    if (lease.get() == nullptr) return runtime_error("{}: libcurl has no memory left", name_);
    std::size_t done = 0;
    for (int failures = 0;;) {
      const Known then = known();
      const Attempt attempt = lease.get()->get(offset + done, out.subspan(done),
                                               done == 0 ? etag : std::string(), should_continue);
      done += attempt.received;
      count(attempt);
      if (attempt.outcome == Attempt::Outcome::kStopped) return stopped();
      Status failure;
      auto kind = TransferEvent::Kind::kFailed;
      if (check == Check::kSame && !is_same(attempt, then)) {
        failure = replaced();
        kind = TransferEvent::Kind::kReplaced;
      } else if (attempt.outcome == Attempt::Outcome::kDone ||
                 (attempt.outcome == Attempt::Outcome::kAgain && done == out.size())) {
        if (check == Check::kNothing || done == out.size()) {
          return Seen{done, attempt.total, attempt.validator, attempt.unchanged};
        }
        failure = replaced();
        kind = TransferEvent::Kind::kReplaced;
      } else if (attempt.outcome == Attempt::Outcome::kHopeless) {
        failure = {attempt.code, fmt::format("{}: {}", name_, attempt.reason)};
      } else {
        failures = attempt.progressed ? 1 : failures + 1;
        if (failures < settings_.max_attempts) {
          STGS_TRY(wait(offset + done, failures, attempt, should_continue));
          continue;
        }
        failure = io_error("{}: {} (given up after {} tries at byte {})", name_, attempt.reason,
                           failures, offset + done);
      }
      tell(kind, offset + done, 0, failure.message());
      return failure;
    }
  }

  void count(const Attempt& attempt) const {
    const std::lock_guard lock(mutex_);
    ++statistics_.requests;
    statistics_.bytes += attempt.received;
    if (attempt.outcome == Attempt::Outcome::kAgain) ++statistics_.retries;
  }

  // Before the next try: each time twice as long, and not for all readers alike.
  Status wait(std::uint64_t offset, int failures, const Attempt& attempt,
              const std::function<bool()>& should_continue) const {
    std::unique_lock lock(mutex_);
    double seconds =
        std::min(settings_.backoff_seconds * std::ldexp(1.0, failures - 1), kLongestWait);
    seconds *= std::uniform_real_distribution<double>(0.75, 1.0)(random_);
    seconds = std::max(seconds, std::min(attempt.retry_after, kLongestWaitAsked));
    lock.unlock();
    tell(TransferEvent::Kind::kRetry, offset, seconds,
         fmt::format("{}: {}", name_, attempt.reason));
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    std::mutex none;
    std::unique_lock pause(none);
    std::condition_variable_any never;
    while (std::chrono::steady_clock::now() < end) {
      if (settings_.stop.stop_requested() || (should_continue && !should_continue()))
        return stopped();
      const auto look = std::chrono::steady_clock::now() + kLook;
      never.wait_until(pause, settings_.stop, std::min<decltype(end)>(end, look),
                       [] { return false; });
    }
    return settings_.stop.stop_requested() ? stopped() : Status();
  }

  std::string url_, name_;
  HttpSettings settings_;
  std::vector<std::uint8_t> head_;             // the file's first bytes
  std::atomic<std::uint64_t> head_bytes_ = 0;  // of these, how many are known to be right

  mutable std::mutex mutex_;  // of what follows
  Known known_;
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
  if (!is_url(url)) return usage_error("{}: not a URL of http or https", url);
  auto source = std::make_unique<Http>(url, settings);
  STGS_TRY(source->open());
  return std::unique_ptr<HttpSource>(std::move(source));
}

}  // namespace stgs::player
