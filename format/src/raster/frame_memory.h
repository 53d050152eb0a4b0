// SPDX-License-Identifier: Apache-2.0
// Allocations of a frame, charged to SplatFrame::memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "stgs/format/raster.h"

namespace stgs::raster {

// Charges `bytes`; `memory` may be null. Throws FrameTooLarge; `what` names the allocation.
inline void charge(WorkingMemory* memory, std::uint64_t bytes, const char* what) {
  if (memory == nullptr || memory->try_charge(bytes)) return;
  throw FrameTooLarge(what, memory->bytes() + bytes);
}

inline void release(WorkingMemory* memory, std::uint64_t bytes) noexcept {
  if (memory != nullptr) memory->release(bytes);
}

template <typename T>
std::uint64_t bytes_of(const std::vector<T>& values) {
  return std::uint64_t{sizeof(T)} * values.capacity();
}

// Frees the memory of `values`.
template <typename T>
void free_values(std::vector<T>& values, WorkingMemory* memory) noexcept {
  const std::uint64_t bytes = bytes_of(values);
  std::vector<T>().swap(values);
  release(memory, bytes);
}

// Increases the capacity to exactly n, if it is less, and preserves the values.
template <typename T>
void reserve(std::vector<T>& values, std::size_t n, WorkingMemory* memory, const char* what) {
  if (n <= values.capacity()) return;
  const std::uint64_t before = bytes_of(values), bytes = std::uint64_t{sizeof(T)} * n;
  charge(memory, bytes, what);
  try {
    values.reserve(n);
  } catch (...) {
    release(memory, bytes);
    throw;
  }
  release(memory, before);
}

// Sets the size. Growing beyond the capacity frees the old values first and allocates exactly n;
// values are then 0, else those beyond the old size.
template <typename T>
void resize(std::vector<T>& values, std::size_t n, WorkingMemory* memory, const char* what) {
  if (n > values.capacity()) {
    free_values(values, memory);
    reserve(values, n, memory, what);
  }
  values.resize(n);
}

}  // namespace stgs::raster
