// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/truth_cache.h"

#include <algorithm>
#include <cstring>
#include <iterator>

namespace stgs::encoder::cuda {
namespace {

constexpr std::size_t kFewest = 4;  // pictures on the device, whatever the budget

}  // namespace

Status TruthCache::create(std::size_t budget) {
  clear();
  budget_ = budget;
  // Memory that pictures have left stays with the process for the next ones.
  int device = 0;
  cudaMemPool_t pool = nullptr;
  std::uint64_t keep = ~std::uint64_t{0};
  STGS_TRY(cuda_status(cudaGetDevice(&device), "asking for the device"));
  STGS_TRY(cuda_status(cudaDeviceGetDefaultMemPool(&pool, device), "asking for the memory pool"));
  STGS_TRY(cuda_status(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep),
                       "setting up the memory pool"));
  for (Staging& staging : staging_) STGS_TRY(staging.copied.create());
  return copies_.create();
}

Result<const std::uint8_t*> TruthCache::acquire(const Image8& image, cudaStream_t stream) {
  Entry* entry = nullptr;
  STGS_TRY(find(image, entry));
  if (!entry->waited) {
    STGS_TRY(cuda_status(cudaStreamWaitEvent(stream, entry->copied, 0), "waiting for a picture"));
    entry->waited = true;
  }
  return static_cast<const std::uint8_t*>(entry->memory);
}

Status TruthCache::release(const Image8& image, cudaStream_t stream) {
  const auto found = entries_.find(image.data.data());
  if (found == entries_.end()) return {};
  found->second.in_use = true;
  return cuda_status(cudaEventRecord(found->second.used, stream), "marking a picture");
}

void TruthCache::clear() {
  for (auto& [key, entry] : entries_) {
    if (entry.memory != nullptr) cudaFreeAsync(entry.memory, copies_);
  }
  cudaStreamSynchronize(copies_);
  entries_.clear();
  held_ = 0;
}

Status TruthCache::find(const Image8& image, Entry*& entry) {
  const auto found = entries_.find(image.data.data());
  if (found == entries_.end()) {
    STGS_TRY(make_room(image.data.size()));
    Entry& made = entries_[image.data.data()];
    STGS_TRY(copy(image, made));
    entry = &made;
  } else {
    entry = &found->second;
  }
  entry->turn = ++turn_;
  return {};
}

// Gives up those used longest ago.
Status TruthCache::make_room(std::size_t bytes) {
  while (held_ + bytes > budget_ && entries_.size() >= kFewest) {
    const auto oldest = std::min_element(
        entries_.begin(), entries_.end(),
        [](const auto& a, const auto& b) { return a.second.turn < b.second.turn; });
    Entry& entry = oldest->second;
    if (entry.in_use) {
      STGS_TRY(cuda_status(cudaStreamWaitEvent(copies_, entry.used, 0), "waiting for a step"));
    }
    if (entry.memory != nullptr) {
      STGS_TRY(cuda_status(cudaFreeAsync(entry.memory, copies_), "freeing a picture"));
      held_ -= entry.bytes;
    }
    entries_.erase(oldest);
  }
  return {};
}

Status TruthCache::copy(const Image8& image, Entry& entry) {
  STGS_TRY(entry.copied.create());
  STGS_TRY(entry.used.create());
  void* memory = nullptr;
  STGS_TRY(cuda_status(cudaMallocAsync(&memory, image.data.size(), copies_),
                       "finding room for a picture"));
  entry.memory = static_cast<std::uint8_t*>(memory);
  entry.bytes = image.data.size();
  held_ += entry.bytes;
  Staging& staging = staging_[next_staging_];
  next_staging_ = (next_staging_ + 1) % std::size(staging_);
  if (staging.busy) {
    STGS_TRY(cuda_status(cudaEventSynchronize(staging.copied), "copying a picture"));
  }
  STGS_TRY(staging.memory.ensure(entry.bytes));
  std::memcpy(staging.memory.data(), image.data.data(), entry.bytes);
  STGS_TRY(cuda_status(cudaMemcpyAsync(entry.memory, staging.memory.data(), entry.bytes,
                                       cudaMemcpyHostToDevice, copies_),
                       "copying a picture"));
  staging.busy = true;
  STGS_TRY(cuda_status(cudaEventRecord(staging.copied, copies_), "copying a picture"));
  return cuda_status(cudaEventRecord(entry.copied, copies_), "copying a picture");
}

}  // namespace stgs::encoder::cuda
