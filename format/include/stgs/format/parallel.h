// SPDX-License-Identifier: Apache-2.0
// Parallel loops on the threads of the current thread's TaskRunner, else on TBB's. Under the thread
// sanitizer they use std::thread instead: TBB is a system library without instrumentation, so every
// hand-over between its threads would be reported as a race. WebAssembly has one thread.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <optional>

#include "stgs/format/task_runner.h"

#if !defined(__EMSCRIPTEN__)
#include <tbb/global_control.h>
#if defined(__SANITIZE_THREAD__)
#include <thread>
#include <vector>
#else
#define STGS_LOOPS_ON_TBB
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <memory>
#include <utility>
#endif
#endif

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

// Calls consume(job) for every job that produce() returns, until it returns none. produce() is
// called by one thread at a time, in order; consume() by several at once. At most `max_jobs` jobs
// exist at a time.
template <typename Job, typename Produce, typename Consume>
void parallel_jobs(int max_jobs, const Produce& produce, const Consume& consume);

// Runs body() on the thread's TaskRunner, if it has one; else directly.
template <typename Body>
void run_as_task(const Body& body);

namespace detail {

#ifdef STGS_LOOPS_ON_TBB
// Starts all threads of TBB; later calls do nothing. TBB ends the process if one of its threads
// cannot start the next one. Here, a failure can be handled: TBB then uses the threads that did
// start. May be called from any thread.
void start_workers();
#endif

// Calls work() on up to `threads` threads and rethrows the first exception. Calls share the work: a
// later one finds nothing left to do.
template <typename Work>
void share(int threads, const Work& work) {
  std::exception_ptr error;
  std::mutex mutex;
  TaskRunner* const runner = task_runner();
  const auto guarded = [&] {
    const ScopedTaskRunner inside(runner);
    try {
      work();
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!error) error = std::current_exception();
    }
  };
  if (runner != nullptr) {
    using Guarded = decltype(guarded);
    runner->run([](void* argument) { (*static_cast<const Guarded*>(argument))(); },
                const_cast<void*>(static_cast<const void*>(&guarded)), threads);
  } else {
#ifdef __SANITIZE_THREAD__
    std::vector<std::thread> others;
    try {
      for (int i = 1; i < threads; ++i) others.emplace_back(guarded);
    } catch (const std::exception&) {  // the threads started so far do the work
    }
    guarded();
    for (std::thread& thread : others) thread.join();
#else
    guarded();
#endif
  }
  if (error) std::rethrow_exception(error);
}

template <typename Index, typename Body>
void share_blocks(Index begin, Index end, Index grain, const Body& body) {
  const Index blocks = (end - begin + grain - 1) / grain;
  std::atomic<Index> next{0};
  share(static_cast<int>(std::min<std::size_t>(blocks, concurrency())), [&] {
    for (Index b = next++; b < blocks; b = next++) {
      const Index first = begin + b * grain;
      try {
        body(first, std::min<Index>(end, first + grain));
      } catch (...) {
        next = blocks;
        throw;
      }
    }
  });
}

template <typename Job, typename Produce, typename Consume>
void share_jobs(int max_jobs, const Produce& produce, const Consume& consume) {
  std::mutex producing;
  bool ended = false;
  share(std::min(max_jobs, concurrency()), [&] {
    for (;;) {
      std::optional<Job> job;
      {
        const std::lock_guard lock(producing);
        if (!ended) job = produce();
        ended = !job;
      }
      if (!job) return;
      consume(*job);
    }
  });
}

}  // namespace detail

inline int concurrency() {
  if (const TaskRunner* runner = task_runner()) return runner->threads();
#if defined(__EMSCRIPTEN__)
  return 1;
#else
  using Control = tbb::global_control;
  const auto limit = static_cast<int>(Control::active_value(Control::max_allowed_parallelism));
#ifdef STGS_LOOPS_ON_TBB
  return std::min(tbb::this_task_arena::max_concurrency(), limit);
#else
  return limit;
#endif
#endif
}

template <typename Index, typename Body>
void parallel_blocks(Index begin, Index end, Index grain, const Body& body) {
  if (!(begin < end)) return;
#ifdef STGS_LOOPS_ON_TBB
  if (task_runner() == nullptr) {
    detail::start_workers();
    return tbb::parallel_for(
        tbb::blocked_range<Index>(begin, end, static_cast<std::size_t>(grain)),
        [&body](const tbb::blocked_range<Index>& range) { body(range.begin(), range.end()); },
        tbb::simple_partitioner());
  }
#endif
  detail::share_blocks(begin, end, grain, body);
}

template <typename Index, typename Body>
void parallel_for(Index begin, Index end, const Body& body) {
  if (!(begin < end)) return;
#ifdef STGS_LOOPS_ON_TBB
  if (task_runner() == nullptr) {
    detail::start_workers();
    return tbb::parallel_for(begin, end, body);
  }
#endif
  detail::share_blocks(begin, end, Index{1}, [&body](Index first, Index) { body(first); });
}

template <typename Job, typename Produce, typename Consume>
void parallel_jobs(int max_jobs, const Produce& produce, const Consume& consume) {
#ifdef STGS_LOOPS_ON_TBB
  if (task_runner() == nullptr) {
    detail::start_workers();
    using Slot = std::shared_ptr<Job>;
    const auto next = [&produce](tbb::flow_control& flow) -> Slot {
      std::optional<Job> job = produce();
      if (job) return std::make_shared<Job>(std::move(*job));
      flow.stop();
      return nullptr;
    };
    return tbb::parallel_pipeline(
        static_cast<std::size_t>(max_jobs),
        tbb::make_filter<void, Slot>(tbb::filter_mode::serial_in_order, next) &
            tbb::make_filter<Slot, void>(tbb::filter_mode::parallel,
                                         [&consume](const Slot& job) { consume(*job); }));
  }
#endif
  detail::share_jobs<Job>(max_jobs, produce, consume);
}

template <typename Body>
void run_as_task(const Body& body) {
  if (task_runner() == nullptr) return body();
  detail::share(1, body);
}

}  // namespace stgs
