// SPDX-License-Identifier: Apache-2.0
#include "stream/follower.h"

#include <chrono>
#include <exception>
#include <utility>

#include "stream/clock_seconds.h"
#include "stream/no_memory.h"

namespace stgs::player {

Follower::Follower(SegmentStore& store, std::shared_ptr<RangeSource> source, IndexCache cache,
                   const PlayerSettings& settings,
                   std::function<void(bool, const std::string&)> on_replaced)
    : store_(store),
      source_(std::move(source)),
      settings_(settings.live),
      limits_(settings.limits),
      memory_(settings.memory != nullptr ? settings.memory.get()
                                         : std::pmr::get_default_resource()),
      on_replaced_(std::move(on_replaced)),
      cache_(std::move(cache)),
      reader_(store.snapshot().reader),
      interval_(settings.live.poll_seconds, clock_seconds()) {
  thread_ = std::thread([this] { run(); });
}

Follower::~Follower() {
  stop();
  thread_.join();
}

void Follower::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stopped_.notify_all();
}

bool Follower::wait() {
  std::unique_lock lock(mutex_);
  stopped_.wait_for(lock, std::chrono::duration<double>(interval_.seconds()),
                    [this] { return stopping_; });
  return !stopping_;
}

void Follower::run() {
  while (reader_->form() == SceneForm::kGrowing && wait()) {
    bool grown = false;
    try {
      grown = poll();
    } catch (const std::exception& e) {
      set_problem(Problem::kUnreadable,
                  failure(e, [&] { return fmt::format("{}: {}", source_->name(), e.what()); }));
    }
    const double now = clock_seconds();
    interval_.update(grown, now);
    if (grown) stall_reported_ = false;
    if (!grown) report_stall(now);
  }
}

// Returns whether the recording has grown.
bool Follower::poll() {
  const Result<ByteSource::Change> change = source_->refresh(reader_->file_bytes());
  if (!change.ok()) {
    set_problem(Problem::kUnreadable, change.status());
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
  if (*change == ByteSource::Change::kResized) {
    retry_ = true;
    return take_snapshot();
  }
  return retry && take_snapshot();
}

bool Follower::take_snapshot() {
  const auto opened = open_snapshot(source_, cache_, limits_, memory_);
  if (!opened.ok()) {
    const StatusCode code = opened.status().code();
    const bool damaged = code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported;
    set_problem(damaged ? Problem::kDamaged : Problem::kUnreadable, opened.status());
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
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;  // reads fail because they are interrupted
  }
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
