// SPDX-License-Identifier: Apache-2.0
// Parallel loops, on the threads of the current thread's TaskRunner, else on default_thread_pool()
// of stgs/format/thread_pool.h. WebAssembly has one thread.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <mutex>
#include <optional>
#include <vector>

#include "stgs/format/task_runner.h"

namespace stgs {

// Returns the number of threads that the functions below use, including the calling one.
int concurrency();

// Primitives of one task in a light loop over primitives, such as a conversion.
inline constexpr std::size_t kPrimitivesPerTask = 8192;

// Calls body(i) for each i of [begin, end), in any order. An exception ends the loop and is
// rethrown.
template <typename Index, typename Body>
void parallel_for(Index begin, Index end, const Body& body);

// Calls body(first, last) for blocks [first, last) that cover [begin, end), each at most `grain` >=
// 1 long.
template <typename Index, typename Body>
void parallel_blocks(Index begin, Index end, Index grain, const Body& body);

// Runs body() on the thread's TaskRunner, if it has one; else directly.
template <typename Body>
void run_as_task(const Body& body);

namespace detail {

// Calls work(argument), which never throws, on up to `threads` threads.
void run_on_threads(void (*work)(void* argument), void* argument, int threads);

// Calls work() on up to `threads` threads and rethrows the first exception. The calls share the
// work: when one returns, calls that start later have nothing to do.
template <typename Work>
void share(int threads, const Work& work) {
  std::exception_ptr error;
  std::mutex mutex;
  const auto guarded = [&, runner = task_runner()] {
    const ScopedTaskRunner inside(runner);
    try {
      work();
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!error) error = std::current_exception();
    }
  };
  using Guarded = decltype(guarded);
  run_on_threads([](void* argument) { (*static_cast<const Guarded*>(argument))(); },
                 const_cast<void*>(static_cast<const void*>(&guarded)), threads);
  if (error) std::rethrow_exception(error);
}

// Distributes the numbers of [0, count) over the threads of a loop. Each thread starts with its own
// contiguous part, so that consecutive loops over the same data reuse the cache of the same core,
// and takes numbers of other parts when its own is exhausted. Thread-safe.
class SharedNumbers {
 public:
  // `threads` >= 1.
  SharedNumbers(std::size_t count, int threads);
  // Returns the first part of the calling thread, the argument of take().
  std::size_t join() { return joined_++ % parts_; }
  // Takes a number of `part`, or of the next part that has one. None: all are taken.
  std::optional<std::size_t> take(std::size_t& part);
  // Discards the remaining numbers.
  void stop();

 private:
  static constexpr std::size_t kMaxParts = 64;
  struct alignas(64) Part {
    std::atomic<std::size_t> next{0};
    std::size_t end = 0;
  };

  const std::size_t parts_;
  std::atomic<std::size_t> joined_{0};
  Part part_[kMaxParts];
};

}  // namespace detail

template <typename Index, typename Body>
void parallel_blocks(Index begin, Index end, Index grain, const Body& body) {
  if (!(begin < end)) return;
  const auto blocks = static_cast<std::size_t>((end - begin + grain - 1) / grain);
  const auto threads = static_cast<int>(std::min<std::size_t>(blocks, concurrency()));
  detail::SharedNumbers numbers(blocks, threads);
  detail::share(threads, [&] {
    std::size_t part = numbers.join();
    while (const auto block = numbers.take(part)) {
      const Index first = begin + static_cast<Index>(*block) * grain;
      try {
        body(first, end - first < grain ? end : first + grain);
      } catch (...) {
        numbers.stop();
        throw;
      }
    }
  });
}

template <typename Index, typename Body>
void parallel_for(Index begin, Index end, const Body& body) {
  if (!(begin < end)) return;
  // Enough blocks to share uneven work evenly.
  constexpr std::size_t kBlocksPerThread = 64;
  const auto blocks = kBlocksPerThread * static_cast<std::size_t>(concurrency());
  const auto grain = std::max<std::size_t>(static_cast<std::size_t>(end - begin) / blocks, 1);
  parallel_blocks(begin, end, static_cast<Index>(grain), [&body](Index first, Index last) {
    for (Index i = first; i < last; ++i) body(i);
  });
}

// Sets `to` to the rows of `components` values of `from` with these indices.
template <typename Array>
void gather_rows(const Array& from, std::size_t components,
                 const std::vector<std::uint32_t>& indices, Array& to) {
  constexpr std::size_t kGrain = 4096;  // rows
  to.resize(indices.size() * components);
  parallel_blocks(std::size_t{0}, indices.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k)
      std::copy_n(from.data() + indices[k] * components, components, to.data() + k * components);
  });
}

template <typename Body>
void run_as_task(const Body& body) {
  if (task_runner() == nullptr) return body();
  detail::share(1, body);
}

}  // namespace stgs
