// SPDX-License-Identifier: Apache-2.0
// The training pictures on the GPU: all of them where they fit in the budget, else the last ones
// used. Copies run on a stream of their own; as the host is some steps ahead of the GPU, a picture
// is there when its step begins.
#pragma once

#include <cstdint>
#include <memory>
#include <unordered_map>

#include "backend/cuda/memory.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder::cuda {

class TruthCache {
 public:
  ~TruthCache() { clear(); }

  // Keeps at most `budget` bytes on the device, but always room for a few pictures; forgets those
  // that it has. Pictures are known by the address of their bytes.
  Status create(std::size_t budget);
  // The picture's bytes on the device, for work that is enqueued on `stream` before release().
  Result<const std::uint8_t*> acquire(const Image8& image, cudaStream_t stream);
  Status release(const Image8& image, cudaStream_t stream);
  // Forgets all pictures, of which none may be in use.
  void clear();

 private:
  struct Entry {
    std::uint8_t* memory = nullptr;
    std::size_t bytes = 0;
    Event copied, used;
    bool waited = false;     // the stream of the steps has waited for `copied`
    bool in_use = false;     // `used` has been recorded
    std::uint64_t turn = 0;  // of the last use
  };
  struct Staging {
    PinnedArray<std::uint8_t> memory;
    Event copied;
    bool busy = false;
  };
  using Entries = std::unordered_map<const std::uint8_t*, Entry>;

  Status find(const Image8& image, Entry*& entry);
  Status make_room(std::size_t bytes);
  Status copy(const Image8& image, Entry& entry);

  std::size_t budget_ = 0, held_ = 0;
  std::uint64_t turn_ = 0;
  Stream copies_;
  Entries entries_;  // by the address of the host's bytes
  Staging staging_[4];
  std::size_t next_staging_ = 0;
};

}  // namespace stgs::encoder::cuda
