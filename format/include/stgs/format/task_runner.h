// SPDX-License-Identifier: Apache-2.0
// Threads of somebody else's for the work of stgs/format/parallel.h.
#pragma once

namespace stgs {

class TaskRunner {
 public:
  virtual ~TaskRunner() = default;
  // That work is shared out for, the caller's included; 1 or more.
  virtual int threads() const = 0;
  // Calls work(argument), which throws nothing, at least once and `count` times at most, at once
  // where it can, and returns when all these calls have returned: one of them alone does all there
  // is to do. Called by several threads at once, and from within work.
  virtual void run(void (*work)(void* argument), void* argument, int count) = 0;
};

// Who runs the work of this thread; null: threads of our own.
TaskRunner* task_runner();

// Makes one the thread's while it lives; null: none.
class ScopedTaskRunner {
 public:
  explicit ScopedTaskRunner(TaskRunner* runner);
  ~ScopedTaskRunner();
  ScopedTaskRunner(const ScopedTaskRunner&) = delete;
  ScopedTaskRunner& operator=(const ScopedTaskRunner&) = delete;

 private:
  TaskRunner* const before_;
};

}  // namespace stgs
