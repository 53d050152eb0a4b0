// SPDX-License-Identifier: Apache-2.0
// The training images on the GPU: all of them if they fit in the budget, else those needed soonest.
// Uploads run on a separate stream from page-locked memory. Because the host runs some steps ahead
// of the GPU, an image is resident by the time its step begins.
#pragma once

#include <cstdint>
#include <set>
#include <unordered_map>
#include <utility>

#include "backend/cuda/memory.h"
#include "train/training_image.h"

namespace stgs::encoder::cuda {

class GroundTruthCache {
 public:
  ~GroundTruthCache() { (void)release_memory(); }

  // Sets the budget, bytes of device memory; the cache always holds a few images, whatever the
  // budget. Removes all images.
  Status create(std::size_t budget);
  // Returns the device address of an image, for work enqueued on `stream` before release(). The
  // host pixels may be freed on return.
  Result<const std::uint8_t*> acquire(const TrainingImage& image, cudaStream_t stream);
  // Marks the end of the enqueued work that uses an acquired image.
  Status release(const TrainingImage& image, cudaStream_t stream);
  // Removes all images; none may be in use.
  void clear();
  // Removes all images and returns their memory to the device, for other allocations.
  Status release_memory();

 private:
  struct Entry {
    std::uint8_t* memory = nullptr;
    std::size_t bytes = 0;
    Event copied, used;
    bool waited = false;  // the steps' stream has waited for `copied`
    bool in_use = false;  // `used` has been recorded
    std::uint64_t next_use = kNeverUsed;
  };
  struct Staging {
    PinnedArray<std::uint8_t> memory;
    Event copied;
    bool busy = false;
  };

  Result<Entry*> find(const TrainingImage& image);
  Status make_space(std::size_t bytes, std::uint64_t now);
  Status evict(std::uint64_t id);
  Status allocate(std::size_t bytes, std::uint64_t now, std::uint8_t*& memory);
  std::uint64_t eviction_candidate(std::uint64_t now) const;
  Status copy(const Image8& image, std::uint8_t* memory, Entry& entry);

  std::size_t budget_ = 0, resident_bytes_ = 0;
  Stream copies_;
  std::unordered_map<std::uint64_t, Entry> entries_;          // by id
  std::set<std::pair<std::uint64_t, std::uint64_t>> by_use_;  // next use, id of each
  Staging staging_[4];
  std::size_t next_staging_ = 0;
};

}  // namespace stgs::encoder::cuda
