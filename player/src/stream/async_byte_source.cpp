// SPDX-License-Identifier: Apache-2.0
#include "stream/async_byte_source.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "stream/clock_seconds.h"
#include "stream/no_memory.h"

namespace stgs::player {

BlockingAdapter::~BlockingAdapter() {
  stop();
  for (std::thread& thread : threads_) thread.join();
}

void BlockingAdapter::start(Completion completion) {
  completion_ = std::move(completion);
  reads_.resize(max_reads_);
  threads_.reserve(max_reads_);
  while (threads_.size() < max_reads_) threads_.emplace_back([this] { run(); });
}

void BlockingAdapter::begin_read(std::uint64_t id, std::uint64_t offset,
                                 std::span<std::uint8_t> out) noexcept {
  {
    const std::lock_guard lock(mutex_);
    const auto free =
        std::find_if(reads_.begin(), reads_.end(), [](const Read& read) { return read.id == 0; });
    *free = {id, offset, out, false, stopping_};
  }
  changed_.notify_one();
}

void BlockingAdapter::cancel(std::uint64_t id) noexcept {
  const std::lock_guard lock(mutex_);
  for (Read& read : reads_) read.cancelled |= read.id == id;
}

void BlockingAdapter::stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (Read& read : reads_) read.cancelled = true;
  }
  changed_.notify_all();
}

BlockingAdapter::Read* BlockingAdapter::find_waiting() {
  const auto found = std::find_if(reads_.begin(), reads_.end(),
                                  [](const Read& read) { return read.id != 0 && !read.running; });
  return found == reads_.end() ? nullptr : &*found;
}

void BlockingAdapter::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    Read* own = nullptr;
    changed_.wait(lock, [&] { return (own = find_waiting()) != nullptr || stopping_; });
    if (own == nullptr) return;
    own->running = true;
    begin_busy();
    lock.unlock();
    Done done = read(*own);
    lock.lock();
    done.busy_seconds = end_busy();
    *own = {};  // before the completion, which may begin another read
    lock.unlock();
    completion_(std::move(done));
    lock.lock();
  }
}

void BlockingAdapter::begin_busy() {
  if (running_++ == 0) busy_since_ = clock_seconds();
}

// Returns the busy time so far.
double BlockingAdapter::end_busy() {
  const double busy = busy_seconds_ + (clock_seconds() - busy_since_);
  if (--running_ == 0) busy_seconds_ = busy;
  return busy;
}

// Of a read that runs, only `cancelled` changes.
BlockingAdapter::Done BlockingAdapter::read(const Read& read) noexcept {
  Done done;
  done.id = read.id;
  const auto should_continue = [this, &read] {
    const std::lock_guard lock(mutex_);
    return !read.cancelled;
  };
  if (!should_continue()) {
    done.status = {StatusCode::kRuntime, "cancelled"};
    return done;
  }
  try {
    done.status = source_->fetch(should_continue, read.offset, read.out, done.from_link);
  } catch (const std::exception& e) {
    done.status = failure(e, [&] {
      return fmt::format("{}: cannot read {} bytes: {}", source_->name(), read.out.size(),
                         e.what());
    });
  }
  return done;
}

}  // namespace stgs::player
