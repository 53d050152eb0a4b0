// SPDX-License-Identifier: Apache-2.0
// The training pictures within a budget of host memory. Where all fit they are decoded once, before
// training; else threads of its own decode ahead of their use, in the order that is announced, and
// what is used last goes first (Belady's rule, which is optimal where the order is known).
//
// Which pictures are handed out never depends on the budget or on timing.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "stgs/encoder/train.h"
#include "stgs/format/status.h"
#include "train/picture.h"

namespace stgs::encoder {

// Mean of 2x2 pixels; an odd last row or column is left out.
Image8 half_size(const Image8& image);

class FrameStore {
 public:
  struct Source {
    struct Size {
      int width = 0, height = 0;  // pixels
    };
    std::vector<Size> views;
    // Decodes a view at full size, 3 channels. Called by several threads at a time.
    std::function<Result<Image8>(std::size_t view)> decode;
  };

  // Level 0 is the full size, 1 half of it.
  static std::uint64_t id_of(std::size_t view, int level) {
    return 2 * view + static_cast<std::uint64_t>(level);
  }

  // `budget` in bytes, of decoded pictures; `threads` decode ahead, at least one.
  FrameStore(Source source, std::uint64_t budget, int threads);
  ~FrameStore();
  FrameStore(const FrameStore&) = delete;
  FrameStore& operator=(const FrameStore&) = delete;

  // Bytes of all pictures of both levels.
  std::uint64_t bytes() const;
  // Decodes all where they fit, else starts the threads. `loaded`, on the caller's thread, is told
  // now and then how many of the views have been decoded; false ends it: kRuntime.
  Status start(const std::function<bool(std::size_t views)>& loaded = nullptr);
  // Announces which pictures will be acquired from now on; replaces what was announced before.
  void announce(std::vector<std::uint64_t> ids);
  // Announced pictures that have not been acquired yet.
  std::size_t announced() const;
  // The next of them; kNeverUsed where there is none.
  std::uint64_t next() const;
  // A picture, announced or not; waits at most until it has been decoded. The error is the
  // decoder's. One thread acquires and announces.
  Result<TrainingImage> acquire(std::uint64_t id);
  FrameStatistics statistics() const;

 private:
  enum class State : std::uint8_t { kAbsent, kDecoding, kReady, kFailed };
  struct Entry {
    State state = State::kAbsent;
    bool held = false;  // counted in used_ and listed in by_use_ where ready
    std::uint64_t next_use = kNeverUsed;
    std::shared_ptr<const Image8> pixels;
    Status error;
  };

  // Bytes of the pictures that are somewhere in memory, also where the store has let go of them.
  struct Alive {
    std::atomic<std::uint64_t> bytes{0}, peak{0};
  };

  std::uint64_t bytes_of(std::uint64_t id) const;
  std::shared_ptr<const Image8> counted(Image8&& image) const;
  Status load_all(const std::function<bool(std::size_t views)>& loaded);
  Status load(std::size_t begin, std::size_t end);
  void work();
  // What to decode ahead, with room for it; kNeverUsed: nothing now.
  std::uint64_t next_job();
  bool make_room(std::uint64_t bytes, std::uint64_t use);
  void hold(std::uint64_t id);
  void drop(std::uint64_t id);
  void set_next_use(std::uint64_t id, std::uint64_t use);
  // Decodes a picture that is marked as being decoded; lets go of the lock meanwhile.
  void decode(std::uint64_t id, std::unique_lock<std::mutex>& lock);
  void take_full_size(std::size_t view, std::shared_ptr<const Image8> pixels);

  const Source source_;
  const std::uint64_t budget_;
  const int thread_count_;
  std::vector<std::thread> threads_;
  mutable std::mutex mutex_;
  std::condition_variable work_, done_;
  bool stop_ = false;
  std::vector<Entry> entries_;  // by id
  // Ready and held pictures, that used last at the end.
  std::set<std::pair<std::uint64_t, std::uint64_t>> by_use_;  // next use, id
  std::vector<std::uint64_t> plan_;                           // announced ids
  std::vector<std::uint64_t> next_after_;                     // use of plan_[i]'s id after i
  std::uint64_t first_ = 0;   // use of plan_[0]; uses count all pictures that were acquired
  std::uint64_t now_ = 0;     // use of the next picture to be acquired
  std::uint64_t looked_ = 0;  // uses up to here are ready or under way
  std::uint64_t used_ = 0;    // bytes held, those being decoded ahead included
  // Shared with the pictures, which may outlive the store.
  const std::shared_ptr<Alive> alive_ = std::make_shared<Alive>();
  FrameStatistics statistics_;  // but for the peak
};

}  // namespace stgs::encoder
