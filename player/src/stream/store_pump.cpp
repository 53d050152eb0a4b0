// SPDX-License-Identifier: Apache-2.0
// SegmentStore: the steps of pump(). Each locks the mutex only for decisions and bookkeeping.
#include <algorithm>
#include <exception>
#include <utility>

#include "stream/clock_seconds.h"
#include "stream/no_memory.h"
#include "stream/segment_store.h"

namespace stgs::player {

PumpResult SegmentStore::pump(double now, double budget) noexcept {
  const double began = clock_seconds();
  PumpResult out;
  for (double passed = 0;; passed = clock_seconds() - began) {
    out.wake_at = std::numeric_limits<double>::infinity();
    out.progressed = step(now + passed, out.wake_at);
    if (!out.progressed || passed >= budget) return out;
  }
}

bool SegmentStore::step(double now, double& wake_at) noexcept {
  executor_->poll();
  bool progressed = collect(now);
  report_replaced();
  cancel_reads(now, wake_at);
  progressed |= start_fetches(now, wake_at);
  progressed |= start_decodes();
  return progressed;
}

// Handles the reads and decoded segments that have arrived.
bool SegmentStore::collect(double now) noexcept {
  {
    const std::lock_guard lock(done_mutex_);
    arrived_.swap(reads_done_);
    finished_.swap(decodes_done_);
  }
  const bool any = !arrived_.empty() || !finished_.empty();
  for (AsyncByteSource::Done& done : arrived_) end_read(std::move(done), now);
  for (Decoded& decoded : finished_) end_decode(std::move(decoded), now);
  arrived_.clear();
  finished_.clear();
  return any;
}

void SegmentStore::cancel_reads(double now, double& wake_at) noexcept {
  for (;;) {
    std::uint64_t id = 0;
    {
      const std::lock_guard lock(mutex_);
      const FetchRequest* request = fetches_.next_cancelled(now, wake_at);
      if (request == nullptr) return;
      id = request->id;
    }
    transport_->cancel(id);
  }
}

// Begins reads until all are in flight that may be.
bool SegmentStore::start_fetches(double now, double& wake_at) noexcept {
  constexpr double kRetryMemorySeconds = 0.1;
  const auto max_reads = static_cast<std::size_t>(settings_.max_reads_in_flight);
  for (bool progressed = false;; progressed = true) {
    FetchScheduler::Next next;
    try {
      const std::lock_guard lock(mutex_);
      if (stopping_ || fetches_.in_flight() >= max_reads) return progressed;
      next = fetches_.next(now);
      if (next.too_large) {
        fail(*next.too_large, false, PlayerEvent::Kind::kReadFailed,
             runtime_error("{}: the active segments take more memory than the budget of {} bytes; "
                           "allow more memory",
                           source_->name(), settings_.memory_budget),
             now);
      }
      out_of_memory_ = false;
    } catch (const std::exception& e) {
      if (!std::exchange(out_of_memory_, true))
        push_event(event_of(PlayerEvent::Kind::kReadFailed, 0, code_of(e), kNoMemory));
      wake_at = std::min(wake_at, now + kRetryMemorySeconds);
      return progressed;
    }
    wake_at = std::min(wake_at, next.wake_at);
    if (next.request != nullptr) {
      begin_fetch(*next.request, now);
    } else if (!next.too_large) {
      return progressed;
    }
  }
}

bool SegmentStore::start_decodes() noexcept {
  for (bool progressed = false;; progressed = true) {
    std::optional<DecodeJob> job;
    {
      const std::lock_guard lock(mutex_);
      if (!stopping_) job = decodes_.next();
    }
    if (!job) return progressed;
    executor_->submit(std::move(*job));
  }
}

// Allocates the buffer of a request and begins its first read.
void SegmentStore::begin_fetch(FetchRequest& request, double now) noexcept {
  try {
    request.buffer = std::make_unique_for_overwrite<std::uint8_t[]>(request.bytes);
  } catch (const std::exception& e) {
    return finish(request, false, read_failure(request, e), now);
  }
  request.charge = budget_->charge(Budget::Pool::kTransfers, request.bytes);
  begin_read(request, now);
}

void SegmentStore::begin_read(FetchRequest& request, double now) noexcept {
  {
    const std::lock_guard lock(mutex_);
    fetches_.begin_read(request, now);
  }
  transport_->begin_read(
      request.id, request.offset + request.done,
      {request.buffer.get() + request.done, static_cast<std::size_t>(request.read_bytes)});
}

void SegmentStore::end_read(AsyncByteSource::Done done, double now) noexcept {
  using Progress = FetchScheduler::Progress;
  FetchRequest* request = nullptr;
  Progress progress = Progress::kFailed;
  {
    const std::lock_guard lock(mutex_);
    request = &fetches_.find(done.id);
    progress = fetches_.end_read(*request, done.status.ok(),
                                 done.from_link ? std::optional(done.busy_seconds) : std::nullopt);
    if (progress == Progress::kMore && stopping_) progress = Progress::kGivenUp;
  }
  if (progress == Progress::kMore) return begin_read(*request, now);
  if (progress == Progress::kComplete) done.status = insert_ranges(*request);
  if (progress == Progress::kGivenUp) done.status = {};
  finish(*request, progress == Progress::kComplete && done.status.ok(), done.status, now);
}

Status SegmentStore::read_failure(const FetchRequest& request,
                                  const std::exception& e) const noexcept {
  return failure(e, [&] {
    return fmt::format("{}: cannot read {} bytes: {}", source_->name(), request.bytes, e.what());
  });
}

// Moves the bytes of a request to where the reader finds them.
Status SegmentStore::insert_ranges(const FetchRequest& request) noexcept {
  try {
    for (const LocatedLayer& own : request.layers)
      source_->insert(own.offset, {request.buffer.get() + (own.offset - request.offset),
                                   static_cast<std::size_t>(own.bytes)});
    return {};
  } catch (const std::exception& e) {
    return read_failure(request, e);
  }
}

// Ends a request: `complete`, given up, or failed.
void SegmentStore::finish(FetchRequest& request, bool complete, const Status& status,
                          double now) noexcept {
  const FileChanges changes = status.ok() ? FileChanges{} : file_changes();
  std::list<FetchRequest> own;  // freed after the mutex is unlocked
  const std::lock_guard lock(mutex_);
  const bool is_current = request.generation == index_.generation();
  own = fetches_.finish(request, complete);
  for (const LocatedLayer& one : request.layers) {
    if (!is_current) {
      source_->erase(one.offset);
    } else if (!status.ok() && !stopping_) {
      fail(one.layer, false, PlayerEvent::Kind::kReadFailed, status, now);
    }
  }
  if (!status.ok()) monitor_.read_failed(is_live(), changes);
}

void SegmentStore::end_decode(Decoded decoded, double now) noexcept {
  DecodeResult& result = decoded.result;
  bool is_suspect = !result.base.ok() || !result.sh.ok();
  if (!is_suspect) {
    const std::lock_guard lock(mutex_);
    is_suspect = monitor_.is_replaced();
  }
  // Asked without the lock, and only if the answer matters.
  const FileChanges changes = is_suspect ? file_changes() : FileChanges{};
  bool is_right_again = false;
  {
    const std::lock_guard lock(mutex_);
    if (decodes_.finish(decoded.job))
      is_right_again = insert_decoded(decoded.job, result, changes, now);
  }
  // From now on, any change counts as another replacement.
  if (is_right_again) source_->set_finished();
}

// Returns whether a replaced file has become the right one again.
bool SegmentStore::insert_decoded(const DecodeJob& job, DecodeResult& result,
                                  const FileChanges& changes, double now) noexcept {
  if (!result.base.ok()) {
    decode_failed({job.segment, false}, result.base, changes, now);
    return false;
  }
  residency_.decoded(job.segment, std::move(result.decoded), job.with_sh && result.sh.ok());
  if (result.sh.ok()) return monitor_.decoded(changes, now);
  decode_failed({job.segment, true}, result.sh, changes, now);
  return false;
}

// Recorded damage is permanent, unless the file was replaced: the right one may be restored. Errors
// of this machine are temporary.
void SegmentStore::decode_failed(const SegmentLayer& layer, const Status& status,
                                 const FileChanges& changes, double now) noexcept {
  using Cause = ChangeMonitor::Cause;
  const Cause cause = monitor_.decode_failed(status.code(), is_live(), changes, now);
  if (cause == Cause::kReplaced) residency_.evict_sh(layer.segment);  // fetched with it
  const bool permanently = (cause == Cause::kDamage || cause == Cause::kNotBuilt) &&
                           residency_.record_damage(layer, status);
  const auto kind =
      cause == Cause::kDamage ? PlayerEvent::Kind::kDamaged : PlayerEvent::Kind::kReadFailed;
  fail(layer, permanently, kind, status, now);
}

// Marks a layer as failed and reports it.
void SegmentStore::fail(const SegmentLayer& layer, bool permanently, PlayerEvent::Kind kind,
                        const Status& status, double now) noexcept {
  residency_.failed(layer, permanently, now);
  append_event(event_of(kind, index_.file_offset(layer), status.code(), status.message()));
}

// Returns whether a Follower checks whether the file was replaced.
bool SegmentStore::is_live() const {
  return settings_.live.follow && index_.reader().form() == SceneForm::kGrowing;
}

FileChanges SegmentStore::file_changes() const {
  return {source_->has_shrunk(), source_->was_modified()};
}

void SegmentStore::report_replaced() noexcept {
  bool replaced = false;
  {
    const std::lock_guard lock(mutex_);
    replaced = monitor_.is_replaced();
  }
  if (std::exchange(replaced_reported_, replaced) != replaced) on_replaced_(replaced);
}

}  // namespace stgs::player
