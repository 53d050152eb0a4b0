// SPDX-License-Identifier: Apache-2.0
#include "init/work.h"

#include <algorithm>
#include <exception>

#include "stgs/format/parallel.h"

namespace stgs::encoder::init {

void Work::stage(const std::string& name, int passes) {
  passes_ = passes;
  passed_ = 0;
  clock_.begin(name);
}

Status Work::report_while(int total, const std::function<Status(Counter&)>& task) {
  const ProgressSink watched = [&](Progress report) {
    report.done = std::min(1.0, (passed_ + report.done) / passes_);
    if (report.done > 0) report.eta_seconds = clock_.seconds() * (1 - report.done) / report.done;
    if (progress_ && !progress_(report)) cancelled_ = true;
    return !cancelled_;
  };
  if (total == 0) return {};
  Status status = run_reporting(clock_.stage(), std::uint64_t(total), watched, task);
  ++passed_;
  return status;
}

Status Work::for_each(int count, const std::function<Status(int)>& task) {
  std::vector<Status> results(count);
  std::atomic<int> failed{count};  // lowest failed index; higher indices are skipped
  const auto run_one = [&](Counter& counter, int i) {
    if (i > failed || !check().ok()) return;
    results[i] = guarded(clock_.stage(), [&] { return task(i); });
    ++counter.done;
    int lowest = failed;
    while (!results[i].ok() && i < lowest && !failed.compare_exchange_weak(lowest, i)) {
    }
  };
  return report_while(count, [&](Counter& counter) -> Status {
    // Blocks of one: tasks are few and long.
    parallel_blocks(0, count, 1, [&](int i, int) { run_one(counter, i); });
    return failed < count ? results[failed] : Status();
  });
}

Status Work::wait_for(const std::function<Status()>& task) {
  return report_while(1, [&](Counter& counter) -> Status {
    STGS_TRY(task());
    ++counter.done;
    return {};
  });
}

Status Work::check() const {
  if (cancelled_) return runtime_error("{}: cancelled", clock_.stage());
  return {};
}

void Work::log(const std::string& line, int level) const {
  if (log_) log_(level, line);
}

Status guarded(const std::string& what, const std::function<Status()>& task) {
  try {
    return task();
  } catch (const std::exception& error) {
    return runtime_error("{}: {}", what, error.what());
  }
}

}  // namespace stgs::encoder::init
