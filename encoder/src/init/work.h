// SPDX-License-Identifier: Apache-2.0
// Runs the stages of the initialisation: parallel loops with errors as values, progress on the
// calling thread, and the duration of each stage.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "capture/reporting.h"
#include "stage_clock.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder::init {

class Work {
 public:
  // Keeps references to both sinks, which must outlive this object.
  Work(const ProgressSink& progress, const LogSink& log) : progress_(progress), log_(log) {}

  // Starts a stage, which lasts until the next call. `passes` is the number of calls of for_each
  // and wait_for in the stage; each is an equal part of its progress.
  void stage(const std::string& name, int passes = 1);
  // Runs task(i) for i in [0, count) on all threads and reports progress on the calling thread.
  // Returns the error of the lowest index. Exceptions become errors. Cancelling skips the tasks
  // that have not started.
  Status for_each(int count, const std::function<Status(int)>& task);
  // Runs `task` on another thread, with progress and cancelling as in for_each.
  Status wait_for(const std::function<Status()>& task);
  // Cancels from outside, like a progress sink that returns false. Thread-safe.
  void cancel() { cancelled_ = true; }
  // Returns kRuntime after cancelling. Long tasks call it regularly. Thread-safe.
  Status check() const;
  // Logs a line. The default level 2 is information.
  void log(const std::string& line, int level = 2) const;
  // Returns the time of each stage, including the current one.
  std::vector<StageTime> timings() const { return clock_.times(); }

 private:
  const ProgressSink& progress_;
  const LogSink& log_;
  Status report_while(int total, const std::function<Status(Counter&)>& task);

  StageClock clock_;
  int passes_ = 1, passed_ = 0;
  std::atomic<bool> cancelled_{false};
};

// Runs `task` and converts an exception to an error that names `what`.
Status guarded(const std::string& what, const std::function<Status()>& task);

}  // namespace stgs::encoder::init
