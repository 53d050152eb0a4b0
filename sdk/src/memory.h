// SPDX-License-Identifier: Apache-2.0
// The caller's allocator as a std::pmr::memory_resource.
#pragma once

#include <memory>
#include <memory_resource>

#include "object.h"

namespace stgs::sdk {

// Returns STGS_OK for NULL and for a complete allocator.
stgs_result check_allocator(const stgs_allocator* allocator, const Log& log);
// Returns the resource of an allocator that has been checked; the heap for NULL.
std::shared_ptr<std::pmr::memory_resource> caller_memory(const stgs_allocator* allocator);

}  // namespace stgs::sdk
