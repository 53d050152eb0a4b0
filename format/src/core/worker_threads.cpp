// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/parallel.h"

#ifdef STGS_LOOPS_ON_TBB
namespace stgs::detail {
namespace {

using Control = tbb::global_control;

// Starts TBB's threads until there are `wanted`, including the calling one. Returns their number,
// which is lower if the system refused one. Each has a task in an arena of its own, which ends when
// all are started: so none is idle, and the next task needs a new one, which enqueue() starts
// before it returns.
int start_threads(int wanted) {
  const auto released = std::make_shared<std::atomic<bool>>(false);
  int threads = 1;
  try {
    for (; threads < wanted; ++threads) {
      tbb::task_arena arena(2, 1);  // this thread and another one
      arena.enqueue([released] { released->wait(false); });
    }
  } catch (const std::exception&) {  // the result states it
  }
  *released = true;
  released->notify_all();
  return threads;
}

}  // namespace

void start_workers() {
  static std::atomic<int> started = 1;  // threads, including the calling one
  const auto wanted = [] {
    return static_cast<int>(Control::active_value(Control::max_allowed_parallelism));
  };
  if (started >= wanted()) return;
  static std::mutex starting;
  const std::lock_guard lock(starting);
  if (started >= wanted()) return;
  const int threads = start_threads(wanted());
  if (threads < wanted()) {
    // Never destroyed: otherwise, TBB would try to start the other threads.
    new Control(Control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  }
  started = threads;
}

}  // namespace stgs::detail
#endif
