// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/parallel.h"

#if !defined(__EMSCRIPTEN__)
#include "stgs/format/thread_pool.h"
#endif

namespace stgs {

int concurrency() {
  if (const TaskRunner* runner = task_runner()) return runner->threads();
#if defined(__EMSCRIPTEN__)
  return 1;
#else
  return default_thread_pool().threads();
#endif
}

namespace detail {

SharedNumbers::SharedNumbers(std::size_t count, int threads)
    : parts_(std::min(static_cast<std::size_t>(threads), kMaxParts)) {
  for (std::size_t i = 0; i < parts_; ++i) {
    part_[i].next = count * i / parts_;
    part_[i].end = count * (i + 1) / parts_;
  }
}

std::optional<std::size_t> SharedNumbers::take(std::size_t& part) {
  for (std::size_t done = 0; done < parts_; ++done) {
    Part& from = part_[part];
    // Read first: the cache line of an exhausted part stays shared between the cores.
    const std::size_t number = from.next < from.end ? from.next++ : from.end;
    if (number < from.end) return number;
    part = (part + 1) % parts_;
  }
  return std::nullopt;
}

void SharedNumbers::stop() {
  for (std::size_t i = 0; i < parts_; ++i) part_[i].next = part_[i].end;
}

void run_on_threads(void (*work)(void* argument), void* argument, int threads) {
  if (TaskRunner* const runner = task_runner()) return runner->run(work, argument, threads);
#if defined(__EMSCRIPTEN__)
  work(argument);
#else
  default_thread_pool().run(work, argument, threads);
#endif
}

}  // namespace detail

}  // namespace stgs
