// SPDX-License-Identifier: Apache-2.0
#include "init/work.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <exception>

namespace stgs::encoder::init {
namespace {

double since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

void Work::stage(const std::string& name) {
  if (!name_.empty()) done_.emplace_back(name_, since(start_));
  name_ = name;
  start_ = std::chrono::steady_clock::now();
}

Status Work::for_each(int count, const std::function<Status(int)>& task) {
  const int batch = std::max(4, 4 * tbb::this_task_arena::max_concurrency());
  const auto begun = std::chrono::steady_clock::now();
  for (int first = 0; first < count; first += batch) {
    const int end = std::min(count, first + batch);
    std::vector<Status> results(end - first);
    tbb::parallel_for(first, end,
                      [&](int i) { results[i - first] = guarded(name_, [&] { return task(i); }); });
    for (const Status& status : results) STGS_TRY(status);
    if (!progress_) continue;
    Progress report;
    report.stage = name_;
    report.done = double(end) / count;
    report.eta_seconds = since(begun) / end * (count - end);
    if (!progress_(report)) return runtime_error("{}: cancelled", name_);
  }
  return {};
}

void Work::log(const std::string& line, int level) const {
  if (log_) log_(level, line);
}

std::vector<std::pair<std::string, double>> Work::timings() const {
  auto all = done_;
  if (!name_.empty()) all.emplace_back(name_, since(start_));
  return all;
}

Status guarded(const std::string& what, const std::function<Status()>& task) {
  try {
    return task();
  } catch (const std::exception& error) {
    return runtime_error("{}: {}", what, error.what());
  }
}

}  // namespace stgs::encoder::init
