// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/ground_truth_cache.h"

#include <cstring>
#include <iterator>

namespace stgs::encoder::cuda {
namespace {

constexpr std::size_t kFewest = 4;  // pictures on the device, whatever the budget

Status default_pool(cudaMemPool_t& pool) {
  int device = 0;
  STGS_TRY(cuda_status(cudaGetDevice(&device), "asking for the device"));
  return cuda_status(cudaDeviceGetDefaultMemPool(&pool, device), "asking for the memory pool");
}

}  // namespace

Status GroundTruthCache::create(std::size_t budget) {
  clear();
  budget_ = budget;
  // Memory that pictures have left stays with the process for the next ones.
  cudaMemPool_t pool = nullptr;
  std::uint64_t keep = ~std::uint64_t{0};
  STGS_TRY(default_pool(pool));
  STGS_TRY(cuda_status(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep),
                       "setting up the memory pool"));
  for (Staging& staging : staging_) STGS_TRY(staging.copied.create());
  return copies_.create();
}

Result<const std::uint8_t*> GroundTruthCache::acquire(const TrainingImage& picture,
                                                      cudaStream_t stream) {
  Entry* entry = nullptr;
  STGS_TRY(find(picture, entry));
  if (!entry->waited) {
    STGS_TRY(cuda_status(cudaStreamWaitEvent(stream, entry->copied, 0), "waiting for a picture"));
    entry->waited = true;
  }
  return static_cast<const std::uint8_t*>(entry->memory);
}

Status GroundTruthCache::release(const TrainingImage& picture, cudaStream_t stream) {
  const auto found = entries_.find(picture.id);
  if (found == entries_.end()) return {};
  found->second.in_use = true;
  return cuda_status(cudaEventRecord(found->second.used, stream), "marking a picture");
}

void GroundTruthCache::clear() {
  for (auto& [id, entry] : entries_) {
    if (entry.memory != nullptr) cudaFreeAsync(entry.memory, copies_);
  }
  cudaStreamSynchronize(copies_);
  entries_.clear();
  by_use_.clear();
  held_ = 0;
}

Status GroundTruthCache::give_back() {
  clear();
  cudaMemPool_t pool = nullptr;
  STGS_TRY(default_pool(pool));
  return cuda_status(cudaMemPoolTrimTo(pool, 0), "giving memory back");
}

Status GroundTruthCache::find(const TrainingImage& picture, Entry*& entry) {
  const auto found = entries_.find(picture.id);
  if (found == entries_.end()) {
    std::uint8_t* memory = nullptr;
    STGS_TRY(allocate(picture.pixels->data.size(), picture.use, memory));
    entry = &entries_[picture.id];
    STGS_TRY(copy(*picture.pixels, memory, *entry));
  } else {
    entry = &found->second;
    by_use_.erase({entry->next_use, picture.id});
  }
  entry->next_use = picture.next_use;
  by_use_.insert({entry->next_use, picture.id});
  return {};
}

// What is past its use (a picture of a size that is not trained on any more), else what is needed
// last; where there is a choice, none that a step under way uses, for the copies would wait for it.
std::uint64_t GroundTruthCache::least_needed(std::uint64_t now) const {
  if (by_use_.begin()->first < now) return by_use_.begin()->second;
  for (auto at = by_use_.rbegin(); at != by_use_.rend(); ++at) {
    const Entry& entry = entries_.at(at->second);
    if (!entry.in_use || cudaEventQuery(entry.used) == cudaSuccess) return at->second;
    (void)cudaGetLastError();  // "not ready" is no error, but remembered as one
  }
  return by_use_.rbegin()->second;
}

Status GroundTruthCache::make_room(std::size_t bytes, std::uint64_t now) {
  while (held_ + bytes > budget_ && entries_.size() >= kFewest) {
    STGS_TRY(evict(least_needed(now)));
  }
  return {};
}

Status GroundTruthCache::evict(std::uint64_t id) {
  Entry& entry = entries_.at(id);
  if (entry.in_use) {
    STGS_TRY(cuda_status(cudaStreamWaitEvent(copies_, entry.used, 0), "waiting for a step"));
  }
  if (entry.memory != nullptr) {
    STGS_TRY(cuda_status(cudaFreeAsync(entry.memory, copies_), "freeing a picture"));
    held_ -= entry.bytes;
  }
  by_use_.erase({entry.next_use, id});
  entries_.erase(id);
  return {};
}

Status GroundTruthCache::allocate(std::size_t bytes, std::uint64_t now, std::uint8_t*& memory) {
  STGS_TRY(make_room(bytes, now));
  for (;;) {
    void* found = nullptr;
    const cudaError_t error = cudaMallocAsync(&found, bytes, copies_);
    memory = static_cast<std::uint8_t*>(found);
    if (error != cudaErrorMemoryAllocation) return cuda_status(error, "finding room for a picture");
    (void)cudaGetLastError();  // told here, and remembered no longer
    if (entries_.size() < kFewest) return no_memory_left(bytes);
    // The steps, or another process, have taken some of what there was.
    STGS_TRY(evict(least_needed(now)));
  }
}

Status GroundTruthCache::copy(const Image8& image, std::uint8_t* memory, Entry& entry) {
  entry.memory = memory;
  entry.bytes = image.data.size();
  held_ += entry.bytes;
  STGS_TRY(entry.copied.create());
  STGS_TRY(entry.used.create());
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
