// SPDX-License-Identifier: Apache-2.0
// Counts allocations through operator new, which heap.cpp replaces in the fuzz programs.
#pragma once

#include <cstdint>

namespace stgs::fuzz {

// From now on, an allocation by any thread that takes the heap more than `bytes` above its present
// size aborts the process with a message.
void limit_heap(std::uint64_t bytes);
// Returns the peak since limit_heap, in bytes above the size at that time.
std::uint64_t heap_peak();
void unlimit_heap();
// Makes the `nth` request of this thread (1: the next) fail; 0, the default: none.
void fail_request(int nth);
// Makes the requests `first` (1: the next) to `last` of all threads fail; 0, 0, the default: none.
void fail_requests(int first, int last);
// Returns whether the first of these requests has occurred.
bool have_failed();
// Returns the bytes in use.
std::uint64_t heap_used();

}  // namespace stgs::fuzz
