// SPDX-License-Identifier: Apache-2.0
// Arrays of floats from a memory resource, which may be created without values.
#pragma once

#include <concepts>
#include <cstddef>
#include <iterator>
#include <memory_resource>
#include <new>
#include <utility>
#include <vector>

namespace stgs {

// Stands for a float whose value is written later.
struct UnsetFloat {
  // Only for the requirements of containers: construct() below is called instead.
  operator float() const { return 0; }
};

// A std::pmr::polymorphic_allocator, except that a float constructed from UnsetFloat has no value.
class FloatAllocator : public std::pmr::polymorphic_allocator<float> {
 public:
  template <typename>
  struct rebind {  // NOLINT(readability-identifier-naming): the standard's name
    using other = FloatAllocator;
  };
  using polymorphic_allocator::polymorphic_allocator;

  void construct(float*, UnsetFloat) noexcept {}
  template <typename... Args>
  requires std::constructible_from<float, Args...>
  void construct(float* at, Args&&... args) {
    ::new (static_cast<void*>(at)) float(std::forward<Args>(args)...);
  }
  // Copies of an array use the heap.
  FloatAllocator select_on_container_copy_construction() const { return {}; }
};

// The components of one attribute.
using FloatArray = std::vector<float, FloatAllocator>;

// Returns an array of `size` floats without values: all must be written before any is read.
FloatArray unset_floats(std::size_t size, const FloatAllocator& allocator);

}  // namespace stgs
