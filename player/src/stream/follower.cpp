// SPDX-License-Identifier: Apache-2.0
#include "stream/follower.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "recycling_memory.h"
#include "stream/clock_seconds.h"
#include "stream/no_memory.h"

namespace stgs::player {

Follower::Follower(SegmentStore& store, std::shared_ptr<RangeSource> source, IndexCache cache,
                   const PlayerSettings& settings, bool polls,
                   std::function<void(bool, const std::string&)> on_replaced)
    : store_(store),
      source_(std::move(source)),
      settings_(settings.live),
      retry_seconds_(settings.retry_seconds),
      polls_(polls),
      limits_(settings.limits),
      memory_(settings.memory != nullptr ? settings.memory.get() : &segment_memory()),
      on_replaced_(std::move(on_replaced)),
      cache_(std::move(cache)),
      reader_(store.snapshot().reader),
      interval_(settings.live.poll_seconds, clock_seconds()),
      polled_at_(clock_seconds()) {}

void Follower::stop() noexcept {
  stopping_ = true;
  source_->interrupt();
}

double Follower::step() noexcept {
  if (source_->is_pending()) return kNever;
  if (!load_failed_ || clock_seconds() >= retry_at_) load();
  if (source_->is_pending()) return kNever;
  double wake_at = load_failed_ ? retry_at_ : kNever;
  if (!is_polling()) return wake_at;
  const bool is_due = clock_seconds() >= next_poll();
  if (is_due) poll_once();
  if (source_->is_pending()) return kNever;
  // After a poll, playback may need more of the index.
  return is_due ? clock_seconds() : std::min(wake_at, next_poll());
}

Status Follower::failure_of(const std::exception& e) const noexcept {
  return failure(e, [&] { return fmt::format("{}: {}", source_->name(), e.what()); });
}

// Loads what playback needs of the index. Reports a failure once.
void Follower::load() noexcept {
  Status status;
  try {
    for (bool loaded = true; loaded && status.ok();) status = load_next(loaded);
  } catch (const std::exception& e) {
    status = failure_of(e);
  }
  if (source_->is_pending()) return;
  const bool failed_before = std::exchange(load_failed_, !status.ok());
  retry_at_ = clock_seconds() + std::max(retry_seconds_, 1e-3);
  if (status.ok() || failed_before || is_overwritten_) return;
  if (stopping_) return;  // reads fail because they are interrupted
  store_.push_event(event_of(PlayerEvent::Kind::kReadFailed, 0, status.code(), status.message()));
}

Status Follower::load_next(bool& loaded) {
  if (stopping_) return runtime_error("{}: stopped", source_->name());
  const std::optional<TickRange> times = store_.unknown_times();
  loaded = times.has_value();
  if (!loaded) return {};
  const auto load = [&](const SceneReader& reader, std::unique_ptr<ByteSource> source) {
    return reader.loaded(std::move(source), times->begin, times->end);
  };
  STGS_ASSIGN(auto reader, extend_snapshot(*reader_, source_, cache_, load));
  // What looks like damage may be another file, and the right one may be restored.
  const bool is_damaged = reader->damage().size() > reader_->damage().size();
  if (is_damaged && (source_->has_shrunk() || source_->was_modified())) {
    const Status status =
        io_error("{}: the file was overwritten or truncated; open it again", source_->name());
    if (!std::exchange(is_overwritten_, true)) on_replaced_(true, status.message());
    return status;
  }
  if (std::exchange(is_overwritten_, false)) {
    source_->set_finished();
    on_replaced_(false, {});
  }
  store_.grow(reader);
  reader_ = std::move(reader);
  return {};
}

void Follower::poll_once() noexcept {
  bool grown = false;
  try {
    grown = poll();
  } catch (const std::exception& e) {
    set_problem(Problem::kUnreadable, failure_of(e));
  }
  if (source_->is_pending()) return;
  polled_at_ = clock_seconds();
  interval_.update(grown, polled_at_);
  if (grown) stall_reported_ = false;
  if (!grown) report_stall(polled_at_);
}

// Returns whether the recording has grown.
bool Follower::poll() {
  if (!is_reading_ && !has_news()) return false;
  is_reading_ = false;
  const bool grown = take_snapshot();
  is_reading_ = source_->is_pending();
  return grown;
}

// Returns whether the file must be read again.
bool Follower::has_news() {
  const Result<ByteSource::Change> change = source_->refresh(reader_->file_bytes());
  if (!change.ok()) {
    if (!source_->is_pending()) set_problem(Problem::kUnreadable, change.status());
    return false;
  }
  if (*change == ByteSource::Change::kReplaced) {
    set_problem(Problem::kReplaced,
                io_error("{}: the file was replaced or truncated; open it again", source_->name()));
    return false;
  }
  if (problem_ == Problem::kReplaced) set_problem(Problem::kNone, {});
  // Read it again after a failure or an incomplete fragment: the size of a file can change before
  // its bytes are readable.
  const bool retry = std::exchange(retry_, false) || problem_ == Problem::kUnreadable;
  if (*change != ByteSource::Change::kResized) return retry;
  retry_ = true;
  return true;
}

// Reads what was added to the file; the complete file if another recording has taken its place.
Result<std::shared_ptr<const SceneReader>> Follower::read_snapshot() {
  const auto refresh = [](const SceneReader& reader, std::unique_ptr<ByteSource> source) {
    return reader.refreshed(std::move(source));
  };
  auto extended = extend_snapshot(*reader_, source_, cache_, refresh);
  if (extended.ok() || extended.status().code() != StatusCode::kInvalidFile) return extended;
  cache_.clear();
  return open_snapshot(source_, cache_, limits_, memory_, IndexLoading::kOnDemand);
}

bool Follower::take_snapshot() {
  const auto opened = read_snapshot();
  if (!opened.ok()) {
    if (source_->is_pending()) return false;
    set_problem(is_damage(opened.status().code()) ? Problem::kDamaged : Problem::kUnreadable,
                opened.status());
    return false;
  }
  set_problem(Problem::kNone, {});
  if ((*opened)->incomplete_bytes() == 0) retry_ = false;
  if ((*opened)->file_bytes() <= reader_->file_bytes()) return false;
  store_.grow(*opened);
  reader_ = *opened;
  if (reader_->form() != SceneForm::kGrowing) source_->set_finished();
  return true;
}

void Follower::set_problem(Problem problem, const Status& status) noexcept {
  const Problem before = std::exchange(problem_, problem);
  if (problem == before) return;
  if (stopping_) return;  // reads fail because they are interrupted
  if (before == Problem::kReplaced) on_replaced_(false, {});
  if (problem == Problem::kNone) return;
  if (problem == Problem::kReplaced) return on_replaced_(true, status.message());
  const auto kind =
      problem == Problem::kDamaged ? PlayerEvent::Kind::kDamaged : PlayerEvent::Kind::kReadFailed;
  store_.push_event(event_of(kind, reader_->file_bytes(), status.code(), status.message()));
}

void Follower::report_stall(double now) noexcept {
  if (stall_reported_ || interval_.idle_seconds(now) < settings_.stall_seconds) return;
  stall_reported_ = true;
  PlayerEvent event;
  event.kind = PlayerEvent::Kind::kStalled;
  event.offset = reader_->file_bytes();
  event.code = StatusCode::kIo;
  try {
    event.message =
        fmt::format("{}: no new data for {:.1f} s", source_->name(), interval_.idle_seconds(now));
  } catch (const std::bad_alloc&) {
    event.message = kNoMemory;
  }
  store_.push_event(std::move(event));
}

}  // namespace stgs::player
