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
      reader_(store.known().reader),
      pace_(settings.live.poll_seconds, clock_seconds()) {
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
  stopped_.wait_for(lock, std::chrono::duration<double>(pace_.seconds()),
                    [this] { return stopping_; });
  return !stopping_;
}

void Follower::run() {
  while (reader_->form() == SceneForm::kGrowing && wait()) {
    bool grown = false;
    try {
      grown = look();
    } catch (const std::exception& e) {
      tell_trouble(Trouble::kUnread,
                   failure(e, [&] { return fmt::format("{}: {}", source_->name(), e.what()); }));
    }
    const double now = clock_seconds();
    pace_.update(grown, now);
    if (grown) stall_told_ = false;
    if (!grown) tell_stall(now);
  }
}

// Whether the recording has grown.
bool Follower::look() {
  const Result<ByteSource::Change> change = source_->refresh(reader_->file_bytes());
  if (!change.ok()) {
    tell_trouble(Trouble::kUnread, change.status());
    return false;
  }
  if (*change == ByteSource::Change::kReplaced) {
    tell_trouble(Trouble::kReplaced,
                 io_error("{}: is another file now, or has lost what it had; open it again",
                          source_->name()));
    return false;
  }
  if (trouble_ == Trouble::kReplaced) tell_trouble(Trouble::kNone, {});
  // Once more where it could not be read, or what had come was not whole: a file's length can be
  // seen before its bytes.
  const bool again = std::exchange(again_, false) || trouble_ == Trouble::kUnread;
  if (*change == ByteSource::Change::kResized) {
    again_ = true;
    return take_snapshot();
  }
  return again && take_snapshot();
}

bool Follower::take_snapshot() {
  const auto opened = open_snapshot(source_, cache_, limits_, memory_);
  if (!opened.ok()) {
    const StatusCode code = opened.status().code();
    const bool damaged = code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported;
    tell_trouble(damaged ? Trouble::kDamaged : Trouble::kUnread, opened.status());
    return false;
  }
  tell_trouble(Trouble::kNone, {});
  if ((*opened)->incomplete_bytes() == 0) again_ = false;
  if ((*opened)->file_bytes() <= reader_->file_bytes()) return false;
  store_.grow(*opened);
  reader_ = *opened;
  if (reader_->form() != SceneForm::kGrowing) source_->set_finished();
  return true;
}

void Follower::tell_trouble(Trouble trouble, const Status& status) noexcept {
  const Trouble before = std::exchange(trouble_, trouble);
  if (trouble == before) return;
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;  // a read that was ended is no news
  }
  if (before == Trouble::kReplaced) on_replaced_(false, {});
  if (trouble == Trouble::kNone) return;
  if (trouble == Trouble::kReplaced) return on_replaced_(true, status.message());
  const auto kind =
      trouble == Trouble::kDamaged ? PlayerEvent::Kind::kDamaged : PlayerEvent::Kind::kReadFailed;
  store_.tell(event_of(kind, reader_->file_bytes(), status.code(), status.message()));
}

void Follower::tell_stall(double now) noexcept {
  if (stall_told_ || pace_.idle_seconds(now) < settings_.stall_seconds) return;
  stall_told_ = true;
  PlayerEvent event;
  event.kind = PlayerEvent::Kind::kStalled;
  event.offset = reader_->file_bytes();
  event.code = StatusCode::kIo;
  try {
    event.message = fmt::format("{}: nothing has been added for {:.1f} s", source_->name(),
                                pace_.idle_seconds(now));
  } catch (const std::bad_alloc&) {
    event.message = kNoMemory;
  }
  store_.tell(std::move(event));
}

}  // namespace stgs::player
