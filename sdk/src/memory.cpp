// SPDX-License-Identifier: Apache-2.0
#include "memory.h"

#include <algorithm>
#include <new>

#include "structs.h"

namespace stgs::sdk {
namespace {

// Alignment of the heap, which vectorised loops rely on.
constexpr std::size_t kMinAlignment = __STDCPP_DEFAULT_NEW_ALIGNMENT__;

class CallerMemory final : public std::pmr::memory_resource {
 public:
  explicit CallerMemory(const stgs_allocator& allocator) : allocator_(allocator) {}

 private:
  void* do_allocate(std::size_t bytes, std::size_t alignment) override {
    void* const memory = allocator_.allocate(allocator_.user, std::max<std::size_t>(bytes, 1),
                                             std::max(alignment, kMinAlignment));
    if (memory == nullptr) throw std::bad_alloc();
    return memory;
  }
  void do_deallocate(void* memory, std::size_t bytes, std::size_t alignment) override {
    allocator_.free(allocator_.user, memory, std::max<std::size_t>(bytes, 1),
                    std::max(alignment, kMinAlignment));
  }
  bool do_is_equal(const std::pmr::memory_resource& other) const noexcept override {
    return this == &other;
  }

  const stgs_allocator allocator_;
};

}  // namespace

stgs_result check_allocator(const stgs_allocator* allocator, const Log& log) {
  if (allocator == nullptr) return STGS_OK;
  stgs_allocator known{};
  if (const stgs_result bad = copy_in(allocator, known); bad != STGS_OK) return bad;
  if (known.allocate != nullptr && known.free != nullptr) return STGS_OK;
  log(STGS_LOG_ERROR, "settings: allocator has no `allocate` or no `free`");
  return STGS_ERROR_ARGUMENT;
}

std::shared_ptr<std::pmr::memory_resource> caller_memory(const stgs_allocator* allocator) {
  if (allocator == nullptr) {
    return {std::shared_ptr<void>(), std::pmr::new_delete_resource()};  // static: never destroyed
  }
  stgs_allocator known{};
  (void)copy_in(allocator, known);
  return std::make_shared<CallerMemory>(known);
}

}  // namespace stgs::sdk
