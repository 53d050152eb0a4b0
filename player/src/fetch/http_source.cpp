// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <random>
#include <vector>

#include "fetch/block_cache.h"
#include "fetch/connection_pool.h"
#include "fetch/other_file.h"
#include "stgs/player/source.h"

namespace stgs::player {
namespace {

constexpr double kMaxBackoff = 5;      // seconds between attempts, unless the server
constexpr double kMaxRetryAfter = 30;  // asks for a longer wait, up to this
// After a read has failed because of the server, reads fail at once for up to this long, seconds,
// unless one succeeds: a reader that continues after failed reads would wait for each of them.
constexpr double kOutage = 5;
constexpr double kBriefFailure = 0.5;  // seconds; a read that fails as soon costs little

}  // namespace

class HttpSource::Impl {
 public:
  Impl(std::string url, HttpSettings settings)
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
    state_ = {response.total, response.total, response.validator, response.origin};
    return {};
  }

  std::uint64_t size() const { return snapshot().size; }
  void set_finished() {
    const std::lock_guard lock(mutex_);
    state_.stable_bytes = state_.size;
    state_.is_finished = true;
  }
  const std::string& name() const { return name_; }

  Result<Change> refresh(std::uint64_t stable_bytes) {
    const Snapshot before = snapshot();
    // The file may have changed beyond `stable_bytes`.
    if (stable_bytes < head_bytes_) head_bytes_ = stable_bytes;
    std::vector<std::uint8_t> head(std::clamp<std::size_t>(head_bytes_, 1, kMaxComparedHead));
    STGS_ASSIGN(const Response response, fetch(0, head, Check::kNothing, tag_of(before)));
    if (!response.unchanged &&
        is_other_file(std::span(head_).first(head_bytes_), stable_bytes,
                      std::span(head).first(response.bytes), response.total)) {
      report(TransferEvent::Kind::kReplaced, 0, 0, replaced().message());
      return Change::kReplaced;
    }
    blocks_.clear();
    const std::lock_guard lock(mutex_);
    state_.stable_bytes = stable_bytes;
    if (response.unchanged) return Change::kNone;
    state_.validator = response.validator;
    state_.origin = response.origin;
    return std::exchange(state_.size, response.total) == response.total ? Change::kNone
                                                                        : Change::kResized;
  }

  Status read_while(const std::function<bool()>& should_continue, std::uint64_t offset,
                    std::span<std::uint8_t> out) const {
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    if (out.empty()) return {};
    if (offset + out.size() <= head_bytes_) {
      std::copy_n(head_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
      return {};
    }
    if (blocks_.count(offset, out.size())) return read_from_block(should_continue, offset, out);
    return fetch(offset, out, Check::kSame, {}, should_continue).status();
  }

  TransferStatistics statistics() const {
    const std::lock_guard lock(mutex_);
    return statistics_;
  }

 private:
  struct Response {
    std::size_t bytes = 0;    // received; fewer than requested at the end of the file
    std::uint64_t total = 0;  // size of the file
    std::string validator;    // ETag, else Last-Modified, else empty
    std::string origin;       // of the server that sent it
    bool unchanged = false;   // since the given ETag; the other members are not set
  };
  enum class Check {
    kNothing,
    kSame  // fail if the file was replaced
  };

  Status replaced() const {
    return io_error("{}: the file on the server was replaced; open it again", name_);
  }
  Status stopped() const { return runtime_error("{}: reading was stopped", name_); }

  // The state of the file as last observed.
  struct Snapshot {
    std::uint64_t size = 0;
    std::uint64_t stable_bytes = 0;  // prefix that is known not to change
    std::string validator, origin;
    bool is_finished = false;  // all of it is stable, and nothing is added
  };
  Snapshot snapshot() const {
    const std::lock_guard lock(mutex_);
    return state_;
  }
  // Returns the validator if it is an ETag, else none.
  static KnownTag tag_of(const Snapshot& snapshot) {
    const std::string& validator = snapshot.validator;
    const bool is_tag = validator.starts_with('"') || validator.starts_with("W/\"");
    return is_tag ? KnownTag{validator, snapshot.origin} : KnownTag{};
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

  // Reads bytes that are in one block, which is read if it is not there.
  Status read_from_block(const std::function<bool()>& should_continue, std::uint64_t offset,
                         std::span<std::uint8_t> out) const {
    if (blocks_.copy(offset, out)) return {};
    const std::uint64_t generation = blocks_.generation(), skipped = offset % blocks_.kBlockBytes;
    const std::uint64_t end = std::max(size(), offset + out.size());  // it may shrink meanwhile
    std::vector<std::uint8_t> block(
        static_cast<std::size_t>(std::min(blocks_.kBlockBytes, end - (offset - skipped))));
    STGS_TRY(fetch(offset - skipped, block, Check::kSame, {}, should_continue).status());
    std::copy_n(block.begin() + static_cast<std::ptrdiff_t>(skipped), out.size(), out.begin());
    blocks_.insert(offset - skipped, std::move(block), generation);
    return {};
  }

  // Reads a range, with retries. If `known` is not empty and still valid, reads nothing.
  Result<Response> fetch(std::uint64_t offset, std::span<std::uint8_t> out, Check check,
                         const KnownTag& known = {},
                         const std::function<bool()>& should_continue = {}) const {
    STGS_TRY(check_outage());
    const Deadline waited(settings_);
    // While a read waits, one that has a connection may find that the server fails.
    const ConnectionPool::Lease lease(
        pool_, [&] { return check_outage().ok() && (!should_continue || should_continue()); });
    if (lease.get() == nullptr) return not_leased(lease.outcome(), offset, waited);
    STGS_TRY(check_outage());
    Deadline deadline(settings_);  // the wait does not count
    std::size_t done = 0;
    Attempt refused;  // the last one without a connection
    for (int failures = 0;;) {
      const Snapshot expected = snapshot();
      Attempt attempt = lease.get()->get(offset + done, out.subspan(done), deadline,
                                         done == 0 ? known : KnownTag{}, should_continue);
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
          end_outage();
          return Response{done, attempt.total, attempt.validator, attempt.origin,
                          attempt.unchanged};
        }
        failure = replaced();
        kind = TransferEvent::Kind::kReplaced;
      } else if (attempt.outcome == Attempt::Outcome::kFatal) {
        failure = {attempt.code, fmt::format("{}: {}", name_, attempt.reason)};
        begin_outage(failure, deadline.elapsed());
      } else {
        // An attempt that lacks the time to connect states less than one that was refused before.
        if (attempt.unreachable) refused = attempt;
        if (attempt.origin.empty() && refused.unreachable) attempt = refused;
        failures = attempt.progressed ? 1 : failures + 1;
        const double pause = pause_after(failures, attempt);
        const bool has_time = pause < deadline.remaining();
        if (failures < settings_.max_attempts && has_time) {
          STGS_TRY(wait(offset + done, pause, attempt, should_continue));
          continue;
        }
        failure = has_time || attempt.unreachable
                      ? gave_up(attempt, failures, offset + done)
                      : timed_out(reason_with_pause(attempt), offset + done, deadline);
        begin_outage(failure, has_time ? deadline.elapsed() : kOutage);
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

  // Returns the error of a read without a connection.
  Status not_leased(ConnectionPool::Lease::Outcome outcome, std::uint64_t offset,
                    const Deadline& waited) const {
    using Outcome = ConnectionPool::Lease::Outcome;
    if (outcome == Outcome::kStopped) {
      const Status outage = settings_.stop.stop_requested() ? Status() : check_outage();
      return outage.ok() ? stopped() : outage;
    }
    if (outcome == Outcome::kOutOfMemory)
      return runtime_error("{}: libcurl is out of memory", name_);
    const Status failure = timed_out("other reads use all connections", offset, waited);
    begin_outage(failure, kOutage);
    report(TransferEvent::Kind::kFailed, offset, 0, failure.message());
    return failure;
  }

  // Returns the error of a read whose last attempt failed by itself.
  Status gave_up(const Attempt& attempt, int failures, std::uint64_t offset) const {
    return io_error("{}: {} (gave up after {} attempt{}){} [byte {}]", name_, attempt.reason,
                    failures, failures == 1 ? "" : "s",
                    attempt.unreachable ? "; check the address and whether the server runs" : "",
                    offset);
  }

  // Returns the error of a read that has no time left for another attempt.
  Status timed_out(const std::string& reason, std::uint64_t offset,
                   const Deadline& deadline) const {
    return io_error("{}: {} (gave up after {:.1f} s); raise url_timeout_seconds [byte {}]", name_,
                    reason, deadline.elapsed(), offset);
  }

  // Sets the error of the reads that follow a failed one, for as many seconds as that took or could
  // have taken.
  void begin_outage(const Status& failure, double seconds) const {
    if (seconds < kBriefFailure) return;
    const std::lock_guard lock(mutex_);
    outage_ = failure;
    const std::chrono::duration<double> time(
        std::min({kOutage, seconds, settings_.request_seconds}));
    outage_end_ =
        Deadline::Clock::now() + std::chrono::duration_cast<Deadline::Clock::duration>(time);
  }

  Status check_outage() const {
    const std::lock_guard lock(mutex_);
    return Deadline::Clock::now() < outage_end_ ? outage_ : Status();
  }

  void end_outage() const {
    const std::lock_guard lock(mutex_);
    outage_end_ = {};
  }

  // Returns the seconds to wait before the next attempt: exponential backoff with jitter, at least
  // as long as the server asks for.
  double pause_after(int failures, const Attempt& attempt) const {
    const int doublings = std::min(failures - 1, 30);
    const double backoff = std::min(std::ldexp(settings_.backoff_seconds, doublings), kMaxBackoff);
    const std::lock_guard lock(mutex_);
    const double jitter = std::uniform_real_distribution<double>(0.75, 1.0)(random_);
    return std::max(backoff * jitter, std::min(attempt.retry_after, kMaxRetryAfter));
  }

  // Waits before the next attempt.
  Status wait(std::uint64_t offset, double seconds, const Attempt& attempt,
              const std::function<bool()>& should_continue) const {
    report(TransferEvent::Kind::kRetry, offset, seconds,
           fmt::format("{}: {}", name_, attempt.reason));
    const auto end = Deadline::Clock::now() + std::chrono::duration<double>(seconds);
    std::mutex none;
    std::unique_lock lock(none);
    std::condition_variable_any never;
    while (Deadline::Clock::now() < end) {
      if (settings_.stop.stop_requested() || (should_continue && !should_continue()))
        return stopped();
      const auto next_check = Deadline::Clock::now() + kPollInterval;
      never.wait_until(lock, settings_.stop, std::min<decltype(end)>(end, next_check),
                       [] { return false; });
    }
    return settings_.stop.stop_requested() ? stopped() : Status();
  }

  std::string url_, name_;
  HttpSettings settings_;
  mutable ConnectionPool pool_{url_, settings_};
  std::vector<std::uint8_t> head_;             // the first bytes of the file
  std::atomic<std::uint64_t> head_bytes_ = 0;  // how many of these are known to be valid

  mutable BlockCache blocks_;

  mutable std::mutex mutex_;  // guards the following members
  Snapshot state_;
  mutable Status outage_;  // of the last read that failed because of the server
  mutable Deadline::Clock::time_point outage_end_;
  mutable TransferStatistics statistics_;
  mutable std::minstd_rand random_{std::random_device{}()};
};

HttpSource::HttpSource(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpSource::~HttpSource() = default;

std::uint64_t HttpSource::size() const {
  return impl_->size();
}

const std::string& HttpSource::name() const {
  return impl_->name();
}

bool HttpSource::may_grow() const {
  return true;
}

Result<ByteSource::Change> HttpSource::refresh(std::uint64_t stable_bytes) {
  return impl_->refresh(stable_bytes);
}

void HttpSource::set_finished() {
  impl_->set_finished();
}

Status HttpSource::read(std::uint64_t offset, std::span<std::uint8_t> out) const {
  return impl_->read_while({}, offset, out);
}

Status HttpSource::read_while(const std::function<bool()>& should_continue, std::uint64_t offset,
                              std::span<std::uint8_t> out) const {
  return impl_->read_while(should_continue, offset, out);
}

TransferStatistics HttpSource::statistics() const {
  return impl_->statistics();
}

bool is_http_built() {
  return true;
}

Result<std::unique_ptr<HttpSource>> open_url(const std::string& url, const HttpSettings& settings) {
  if (!is_url(url)) return usage_error("{}: not an HTTP URL (expected http:// or https://)", url);
  const auto is_within = [](double value, double min, double max) {
    return value >= min && value <= max;  // false for NaN
  };
  if (!is_within(settings.request_seconds, kMinRequestSeconds, kMaxRequestSeconds) ||
      !is_within(settings.min_bytes_per_second, kMinBytesPerSecond, kMaxBytesPerSecond)) {
    return usage_error(
        "transfer settings out of range (expected request_seconds {:g} to {:g}, "
        "min_bytes_per_second {:g} to {:g})",
        kMinRequestSeconds, kMaxRequestSeconds, kMinBytesPerSecond, kMaxBytesPerSecond);
  }
  auto impl = std::make_unique<HttpSource::Impl>(url, settings);
  STGS_TRY(impl->open());
  return std::make_unique<HttpSource>(std::move(impl));
}

}  // namespace stgs::player
