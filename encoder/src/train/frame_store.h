// SPDX-License-Identifier: Apache-2.0
// Decoded training images within a budget of host memory. If all images fit, they are decoded once,
// before training. Otherwise the store's threads decode ahead of use, in the announced order, and
// the image with the latest next use is evicted first (Belady's rule, which is optimal because the
// order is known).
//
// The images returned never depend on the budget or on timing.
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
#include "train/training_image.h"

namespace stgs::encoder {

class FrameStore {
 public:
  using ImagePtr = std::shared_ptr<const Image8>;

  struct Source {
    struct Size {
      int width = 0, height = 0;  // pixels
    };
    std::vector<Size> views;
    // Returns a view at full size, 3 channels. Called concurrently from several threads.
    std::function<Result<ImagePtr>(std::size_t view)> decode;
  };

  // Returns the id of an image. Level 0 is the full size, 1 the half size.
  static std::uint64_t id_of(std::size_t view, int level) {
    return 2 * view + static_cast<std::uint64_t>(level);
  }

  // `budget`: bytes of decoded images. `threads`: threads that decode ahead, at least one.
  FrameStore(Source source, std::uint64_t budget, int threads);
  ~FrameStore();
  FrameStore(const FrameStore&) = delete;
  FrameStore& operator=(const FrameStore&) = delete;

  // Returns the size of all images at both levels, bytes.
  std::uint64_t bytes() const;
  // Decodes all images if they fit, else starts the threads. While decoding all, it periodically
  // calls `loaded` on the calling thread with the number of decoded views; kRuntime if `loaded`
  // returns false.
  Status start(const std::function<bool(std::size_t views)>& loaded = nullptr);
  // Announces the images to be acquired from now on, in order; replaces the previous announcement.
  void announce(std::vector<std::uint64_t> ids);
  // Returns the number of announced images not yet acquired.
  std::size_t announced() const;
  // Returns the id of the next announced image; kNeverUsed if there is none.
  std::uint64_t next() const;
  // Returns an image, announced or not; blocks until it is decoded. The error is the decoder's.
  // Call acquire() and announce() from the same thread.
  Result<TrainingImage> acquire(std::uint64_t id);
  FrameStatistics statistics() const;

 private:
  enum class State : std::uint8_t { kAbsent, kDecoding, kReady, kFailed };
  struct Entry {
    State state = State::kAbsent;
    bool resident = false;  // counted in used_; listed in by_use_ if ready
    std::uint64_t next_use = kNeverUsed;
    ImagePtr pixels;
    Status error;
  };

  // Bytes of all images in memory, including those that the store has evicted but others still use.
  struct MemoryUse {
    std::atomic<std::uint64_t> bytes{0}, peak{0};
  };

  std::uint64_t bytes_of(std::uint64_t id) const;
  // Counts an image in the memory use until its last user releases it.
  ImagePtr counted(ImagePtr image) const;
  Status load_all(const std::function<bool(std::size_t views)>& loaded);
  Status load(std::size_t begin, std::size_t end);
  void work();
  // Reserves space for the next image to decode ahead and returns its id; kNeverUsed: none now.
  std::uint64_t next_job();
  bool make_space(std::uint64_t bytes, std::uint64_t use);
  void make_resident(std::uint64_t id);
  void evict(std::uint64_t id);
  void set_next_use(std::uint64_t id, std::uint64_t use);
  // Decodes an image in the state kDecoding; releases the lock meanwhile.
  void decode(std::uint64_t id, std::unique_lock<std::mutex>& lock);
  void insert_full_size(std::size_t view, ImagePtr pixels);

  const Source source_;
  const std::uint64_t budget_;
  const int thread_count_;
  std::vector<std::thread> threads_;
  mutable std::mutex mutex_;
  std::condition_variable work_, done_;
  bool stop_ = false;
  std::vector<Entry> entries_;  // by id
  // Ready and resident images, by next use.
  std::set<std::pair<std::uint64_t, std::uint64_t>> by_use_;  // next use, id
  std::vector<std::uint64_t> plan_;                           // announced ids
  std::vector<std::uint64_t> next_after_;                     // next use of plan_[i]'s id after i
  std::uint64_t first_ = 0;    // use of plan_[0]; uses count all acquired images
  std::uint64_t now_ = 0;      // use of the next image to be acquired
  std::uint64_t scanned_ = 0;  // uses before this one are ready or being decoded
  std::uint64_t used_ = 0;     // resident bytes, including images being decoded ahead
  // Shared with the images, which may outlive the store.
  const std::shared_ptr<MemoryUse> memory_use_ = std::make_shared<MemoryUse>();
  FrameStatistics statistics_;  // except the peak
};

}  // namespace stgs::encoder
