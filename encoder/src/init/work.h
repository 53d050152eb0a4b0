// SPDX-License-Identifier: Apache-2.0
// Running the stages of the initialisation: parallel loops with errors as values, progress on the
// caller's thread, and the time that each stage took.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "capture/reporting.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder::init {

class Work {
 public:
  Work(const ProgressSink& progress, const LogSink& log) : progress_(progress), log_(log) {}

  // Starts a stage: what for_each reports belongs to it, and so does the time until the next one.
  // `passes`: calls of for_each and wait_for that it is made of, each an equal part of its
  // progress.
  void stage(const std::string& name, int passes = 1);
  // Runs task(i) for i in [0, count) on TBB's threads, while the caller's thread reports progress
  // some times a second. The error of the lowest index wins; exceptions of the libraries used
  // become errors. Once cancelled, what has not begun is left out.
  Status for_each(int count, const std::function<Status(int)>& task);
  // Runs `task` on a thread of its own, with progress and cancelling as above.
  Status wait_for(const std::function<Status()>& task);
  // An error once the caller has cancelled: what takes long asks now and then. Any thread.
  Status check() const;
  // A line at level 2 (information) unless told otherwise.
  void log(const std::string& line, int level = 2) const;
  // Seconds by stage, finished ones and the current one.
  std::vector<std::pair<std::string, double>> timings() const;

 private:
  const ProgressSink& progress_;
  const LogSink& log_;
  Status report_while(int total, const std::function<Status(Counter&)>& task);

  std::string name_;
  int passes_ = 1, passed_ = 0;
  std::atomic<bool> cancelled_{false};
  std::chrono::steady_clock::time_point start_;
  std::vector<std::pair<std::string, double>> done_;
};

// Runs `task`, turning an exception into an error that names `what`.
Status guarded(const std::string& what, const std::function<Status()>& task);

}  // namespace stgs::encoder::init
