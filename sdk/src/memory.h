// SPDX-License-Identifier: Apache-2.0
// The caller's memory as a std::pmr one.
#pragma once

#include <memory>
#include <memory_resource>

#include "object.h"

namespace stgs::sdk {

// STGS_OK where there is none, and where it can be used.
stgs_result check_allocator(const stgs_allocator* allocator, const Log& log);
// The heap where there is none. One that has been checked.
std::shared_ptr<std::pmr::memory_resource> caller_memory(const stgs_allocator* allocator);

}  // namespace stgs::sdk
