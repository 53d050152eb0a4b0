// SPDX-License-Identifier: Apache-2.0
// The caller's threads, for the parallel loops of stgs/format/parallel.h.
#pragma once

namespace stgs {

// Runs parallel work on threads of the application.
class TaskRunner {
 public:
  virtual ~TaskRunner() = default;
  // Returns the number of threads to split work for, including the calling one; 1 or more.
  virtual int threads() const = 0;
  // Calls work(argument), which never throws, between one and `count` times, concurrently if
  // possible, and returns when all calls have returned. A single call completes all of the work.
  // Called from several threads at once, and from within `work`.
  virtual void run(void (*work)(void* argument), void* argument, int count) = 0;
};

// Returns the runner of this thread; null: the library uses its own threads.
TaskRunner* task_runner();

// Sets the runner of this thread for the lifetime of the object; null: none.
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
