// SPDX-License-Identifier: Apache-2.0
#include "heap.h"

#include <malloc.h>

#include <atomic>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <new>

namespace {

constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max();
std::atomic<std::int64_t> used{0}, start{0}, peak{0}, limit{kNoLimit};
thread_local int until_failure = 0;  // requests up to the failing one; 0: none fails
std::atomic<int> requests{0}, first_failure{0}, last_failure{0};  // over all threads; 0: none fails

bool must_fail() {
  if (until_failure > 0 && --until_failure == 0) return true;
  if (last_failure == 0) return false;
  const int request = ++requests;
  return request >= first_failure && request <= last_failure;
}

// `alignment`: 0 for that of malloc.
void* allocate(std::size_t size, std::size_t alignment = 0) {
  if (must_fail()) throw std::bad_alloc();
  // Checks the limit before allocating, because afterwards the memory is already taken.
  const auto requested = static_cast<std::int64_t>(size);
  if (requested < 0 || used + requested > limit) {
    std::fprintf(stderr,
                 "fuzz: allocating %zu bytes with %lld in use exceeds the limit of %lld bytes\n",
                 size, static_cast<long long>(used - start), static_cast<long long>(limit - start));
    std::abort();
  }
  void* const memory =
      alignment <= alignof(std::max_align_t)
          ? std::malloc(size == 0 ? 1 : size)
          : std::aligned_alloc(alignment, (size + alignment) / alignment * alignment);
  if (memory == nullptr) throw std::bad_alloc();
  const std::int64_t now = used += static_cast<std::int64_t>(malloc_usable_size(memory));
  std::int64_t highest = peak;
  while (now > highest && !peak.compare_exchange_weak(highest, now)) {
  }
  return memory;
}

void release(void* memory) {
  if (memory == nullptr) return;
  used -= static_cast<std::int64_t>(malloc_usable_size(memory));
  std::free(memory);
}

}  // namespace

void* operator new(std::size_t size) {
  return allocate(size);
}
void* operator new[](std::size_t size) {
  return allocate(size);
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  try {
    return allocate(size);
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}
void* operator new[](std::size_t size, const std::nothrow_t& tag) noexcept {
  return operator new(size, tag);
}
// The standard's memory resources, from which sets of primitives allocate, call these.
void* operator new(std::size_t size, std::align_val_t alignment) {
  return allocate(size, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t size, std::align_val_t alignment) {
  return allocate(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory, std::align_val_t) noexcept {
  release(memory);
}
void operator delete[](void* memory, std::align_val_t) noexcept {
  release(memory);
}
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept {
  release(memory);
}
void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept {
  release(memory);
}
void operator delete(void* memory) noexcept {
  release(memory);
}
void operator delete[](void* memory) noexcept {
  release(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  release(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  release(memory);
}
void operator delete(void* memory, const std::nothrow_t&) noexcept {
  release(memory);
}
void operator delete[](void* memory, const std::nothrow_t&) noexcept {
  release(memory);
}

namespace stgs::fuzz {

void limit_heap(std::uint64_t bytes) {
  start = used.load();
  peak = used.load();
  limit = used + static_cast<std::int64_t>(bytes);
}
std::uint64_t heap_peak() {
  return static_cast<std::uint64_t>(peak - start);
}
void unlimit_heap() {
  limit = kNoLimit;
}
void fail_request(int nth) {
  until_failure = nth;
}
void fail_requests(int first, int last) {
  last_failure = 0;
  requests = 0;
  first_failure = first;
  last_failure = last;
}
bool have_failed() {
  return requests >= first_failure;
}
std::uint64_t heap_used() {
  return static_cast<std::uint64_t>(used);
}

}  // namespace stgs::fuzz
