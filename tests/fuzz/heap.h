// SPDX-License-Identifier: Apache-2.0
// Counts what is allocated through operator new, which heap.cpp replaces in the fuzz programs.
#pragma once

#include <cstdint>

namespace stgs::fuzz {

// From here on, an allocation by any thread that takes the heap more than `bytes` above what it has
// now ends the process with a message.
void limit_heap(std::uint64_t bytes);
// Most bytes above the start since limit_heap.
std::uint64_t heap_peak();
void unlimit_heap();
// This thread's `nth` request from here on (1: the next) finds no memory; 0: none does, which is so
// at first.
void fail_request(int nth);
// Requests of all threads from number `first` (1: the next) to `last` find no memory; 0, 0: all do,
// which is so at first.
void fail_requests(int first, int last);
// Whether one of them has come.
bool have_failed();
// Bytes in use now.
std::uint64_t heap_used();

}  // namespace stgs::fuzz
