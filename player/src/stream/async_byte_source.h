// SPDX-License-Identifier: Apache-2.0
// Reads that do not block the caller.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "stgs/format/status.h"
#include "stream/range_source.h"

namespace stgs::player {

// Reads byte ranges asynchronously. One thread calls it, except for stop().
class AsyncByteSource {
 public:
  // The end of a read.
  struct Done {
    std::uint64_t id = 0;
    Status status;
    bool from_link = true;  // false: the bytes were in memory
    // Time so far during which at least one read was running, without waiting for a thread.
    double busy_seconds = 0;
  };
  // Receives the end of each read, on any thread, also within begin_read(). Must not throw.
  using Completion = std::function<void(Done)>;

  virtual ~AsyncByteSource() = default;
  // Accepts reads from now on. Call it once.
  virtual void start(Completion completion) = 0;
  // Begins to fill `out`, which stays valid until the completion, from `offset` on. `id` is unique
  // among the reads in flight.
  virtual void begin_read(std::uint64_t id, std::uint64_t offset,
                          std::span<std::uint8_t> out) noexcept = 0;
  // Ends a read early, within half a second; its completion receives an error, or the bytes if
  // these have arrived.
  virtual void cancel(std::uint64_t id) noexcept = 0;
  // Cancels all reads. Later ones fail. Thread-safe.
  virtual void stop() noexcept = 0;
};

// Runs blocking reads on threads. The destructor waits for the reads in flight.
class BlockingAdapter final : public AsyncByteSource {
 public:
  // At most `max_reads` reads are in flight.
  BlockingAdapter(std::shared_ptr<RangeSource> source, int max_reads)
      : source_(std::move(source)), max_reads_(static_cast<std::size_t>(max_reads)) {}
  ~BlockingAdapter() override;
  void start(Completion completion) override;
  void begin_read(std::uint64_t id, std::uint64_t offset,
                  std::span<std::uint8_t> out) noexcept override;
  void cancel(std::uint64_t id) noexcept override;
  void stop() noexcept override;

 private:
  struct Read {
    std::uint64_t id = 0, offset = 0;
    std::span<std::uint8_t> out;
    bool running = false, cancelled = false;
  };

  void run();
  Done read(const Read& read) noexcept;
  Read* find_waiting();
  void begin_busy();
  double end_busy();

  const std::shared_ptr<RangeSource> source_;
  const std::size_t max_reads_;
  Completion completion_;
  std::mutex mutex_;  // guards the following members
  std::condition_variable changed_;
  std::vector<Read> reads_;  // max_reads_; those with an id of 0 are free
  int running_ = 0;
  double busy_since_ = 0;    // if any is running, clock seconds
  double busy_seconds_ = 0;  // before that
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace stgs::player
