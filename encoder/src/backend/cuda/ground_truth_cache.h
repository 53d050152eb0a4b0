// SPDX-License-Identifier: Apache-2.0
// The training pictures on the GPU: all of them where they fit in the budget, else those that are
// needed soonest. Copies run on a stream of their own, from pinned memory; as the host is some
// steps ahead of the GPU, a picture is there when its step begins.
#pragma once

#include <cstdint>
#include <set>
#include <unordered_map>
#include <utility>

#include "backend/cuda/memory.h"
#include "train/picture.h"

namespace stgs::encoder::cuda {

class GroundTruthCache {
 public:
  ~GroundTruthCache() { (void)give_back(); }

  // Keeps at most `budget` bytes on the device, but always room for a few pictures; forgets those
  // that it has.
  Status create(std::size_t budget);
  // The picture's bytes on the device, for work that is enqueued on `stream` before release().
  // The pixels on the host are not needed any more when this returns.
  Result<const std::uint8_t*> acquire(const TrainingImage& picture, cudaStream_t stream);
  Status release(const TrainingImage& picture, cudaStream_t stream);
  // Forgets all pictures, of which none may be in use.
  void clear();
  // The same, and what they took is the device's again: others find more room after it.
  Status give_back();

 private:
  struct Entry {
    std::uint8_t* memory = nullptr;
    std::size_t bytes = 0;
    Event copied, used;
    bool waited = false;  // the stream of the steps has waited for `copied`
    bool in_use = false;  // `used` has been recorded
    std::uint64_t next_use = kNeverUsed;
  };
  struct Staging {
    PinnedArray<std::uint8_t> memory;
    Event copied;
    bool busy = false;
  };

  Status find(const TrainingImage& picture, Entry*& entry);
  Status make_room(std::size_t bytes, std::uint64_t now);
  Status evict(std::uint64_t id);
  Status allocate(std::size_t bytes, std::uint64_t now, std::uint8_t*& memory);
  std::uint64_t least_needed(std::uint64_t now) const;
  Status copy(const Image8& image, std::uint8_t* memory, Entry& entry);

  std::size_t budget_ = 0, held_ = 0;
  Stream copies_;
  std::unordered_map<std::uint64_t, Entry> entries_;          // by id
  std::set<std::pair<std::uint64_t, std::uint64_t>> by_use_;  // next use, id of each
  Staging staging_[4];
  std::size_t next_staging_ = 0;
};

}  // namespace stgs::encoder::cuda
