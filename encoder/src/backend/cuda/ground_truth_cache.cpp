// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/ground_truth_cache.h"

#include <cstring>
#include <iterator>

namespace stgs::encoder::cuda {
namespace {

constexpr std::size_t kMinImages = 4;  // on the device, whatever the budget

Status default_pool(cudaMemPool_t& pool) {
  int device = 0;
  STGS_TRY(cuda_status(cudaGetDevice(&device), "querying the device"));
  return cuda_status(cudaDeviceGetDefaultMemPool(&pool, device), "querying the memory pool");
}

}  // namespace

Status GroundTruthCache::create(std::size_t budget) {
  clear();
  budget_ = budget;
  // Freed memory remains in the pool for the next images.
  cudaMemPool_t pool = nullptr;
  std::uint64_t threshold = ~std::uint64_t{0};
  STGS_TRY(default_pool(pool));
  STGS_TRY(cuda_status(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &threshold),
                       "setting up the memory pool"));
  for (Staging& staging : staging_) STGS_TRY(staging.copied.create());
  return copies_.create();
}

Result<const std::uint8_t*> GroundTruthCache::acquire(const TrainingImage& image,
                                                      cudaStream_t stream) {
  STGS_ASSIGN(Entry* const entry, find(image));
  if (!entry->waited) {
    STGS_TRY(cuda_status(cudaStreamWaitEvent(stream, entry->copied, 0), "waiting for an image"));
    entry->waited = true;
  }
  return static_cast<const std::uint8_t*>(entry->memory);
}

Status GroundTruthCache::release(const TrainingImage& image, cudaStream_t stream) {
  const auto found = entries_.find(image.id);
  if (found == entries_.end()) return {};
  found->second.in_use = true;
  return cuda_status(cudaEventRecord(found->second.used, stream), "marking an image");
}

void GroundTruthCache::clear() {
  for (auto& [id, entry] : entries_) {
    if (entry.memory != nullptr) cudaFreeAsync(entry.memory, copies_);
  }
  cudaStreamSynchronize(copies_);
  entries_.clear();
  by_use_.clear();
  resident_bytes_ = 0;
}

Status GroundTruthCache::release_memory() {
  clear();
  cudaMemPool_t pool = nullptr;
  STGS_TRY(default_pool(pool));
  return cuda_status(cudaMemPoolTrimTo(pool, 0), "releasing memory");
}

Result<GroundTruthCache::Entry*> GroundTruthCache::find(const TrainingImage& image) {
  Entry* entry = nullptr;
  const auto found = entries_.find(image.id);
  if (found == entries_.end()) {
    std::uint8_t* memory = nullptr;
    STGS_TRY(allocate(image.pixels->data.size(), image.use, memory));
    entry = &entries_[image.id];
    STGS_TRY(copy(*image.pixels, memory, *entry));
  } else {
    entry = &found->second;
    by_use_.erase({entry->next_use, image.id});
  }
  entry->next_use = image.next_use;
  by_use_.insert({entry->next_use, image.id});
  return entry;
}

// Returns an image past its use (of a size no longer trained on), else the image with the latest
// next use. Prefers images that no step in flight uses, because the uploads would wait for it.
std::uint64_t GroundTruthCache::eviction_candidate(std::uint64_t now) const {
  if (by_use_.begin()->first < now) return by_use_.begin()->second;
  for (auto at = by_use_.rbegin(); at != by_use_.rend(); ++at) {
    const Entry& entry = entries_.at(at->second);
    if (!entry.in_use || cudaEventQuery(entry.used) == cudaSuccess) return at->second;
    (void)cudaGetLastError();  // clears "not ready", which is not an error
  }
  return by_use_.rbegin()->second;
}

Status GroundTruthCache::make_space(std::size_t bytes, std::uint64_t now) {
  while (resident_bytes_ + bytes > budget_ && entries_.size() >= kMinImages) {
    STGS_TRY(evict(eviction_candidate(now)));
  }
  return {};
}

Status GroundTruthCache::evict(std::uint64_t id) {
  Entry& entry = entries_.at(id);
  if (entry.in_use) {
    STGS_TRY(cuda_status(cudaStreamWaitEvent(copies_, entry.used, 0), "waiting for a step"));
  }
  if (entry.memory != nullptr) {
    STGS_TRY(cuda_status(cudaFreeAsync(entry.memory, copies_), "freeing an image"));
    resident_bytes_ -= entry.bytes;
  }
  by_use_.erase({entry.next_use, id});
  entries_.erase(id);
  return {};
}

Status GroundTruthCache::allocate(std::size_t bytes, std::uint64_t now, std::uint8_t*& memory) {
  STGS_TRY(make_space(bytes, now));
  for (;;) {
    void* found = nullptr;
    const cudaError_t error = cudaMallocAsync(&found, bytes, copies_);
    memory = static_cast<std::uint8_t*>(found);
    if (error != cudaErrorMemoryAllocation) return cuda_status(error, "allocating an image");
    (void)cudaGetLastError();  // handled here
    if (entries_.size() < kMinImages) return out_of_memory(bytes);
    // The steps or another process have allocated some of the memory.
    STGS_TRY(evict(eviction_candidate(now)));
  }
}

Status GroundTruthCache::copy(const Image8& image, std::uint8_t* memory, Entry& entry) {
  entry.memory = memory;
  entry.bytes = image.data.size();
  resident_bytes_ += entry.bytes;
  STGS_TRY(entry.copied.create());
  STGS_TRY(entry.used.create());
  Staging& staging = staging_[next_staging_];
  next_staging_ = (next_staging_ + 1) % std::size(staging_);
  if (staging.busy) {
    STGS_TRY(cuda_status(cudaEventSynchronize(staging.copied), "uploading an image"));
  }
  STGS_TRY(staging.memory.ensure(entry.bytes));
  std::memcpy(staging.memory.data(), image.data.data(), entry.bytes);
  STGS_TRY(cuda_status(cudaMemcpyAsync(entry.memory, staging.memory.data(), entry.bytes,
                                       cudaMemcpyHostToDevice, copies_),
                       "uploading an image"));
  staging.busy = true;
  STGS_TRY(cuda_status(cudaEventRecord(staging.copied, copies_), "uploading an image"));
  return cuda_status(cudaEventRecord(entry.copied, copies_), "uploading an image");
}

}  // namespace stgs::encoder::cuda
