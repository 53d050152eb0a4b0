// SPDX-License-Identifier: Apache-2.0
#include "stage_clock.h"

#include <fmt/format.h>

#include <algorithm>
#include <ctime>

namespace stgs::encoder {
namespace {

double core_seconds() {
  timespec used{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

}  // namespace

double StageClock::seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void StageClock::begin(const std::string& name) {
  done_ = times();
  name_ = name;
  start_ = std::chrono::steady_clock::now();
  core_start_ = core_seconds();
}

std::vector<StageTime> StageClock::times() const {
  std::vector<StageTime> out = done_;
  if (name_.empty()) return out;
  auto stage = std::find_if(out.begin(), out.end(),
                            [this](const StageTime& known) { return known.name == name_; });
  if (stage == out.end()) stage = out.insert(out.end(), {name_, 0, 0});
  stage->seconds += seconds();
  stage->core_seconds += core_seconds() - core_start_;
  return out;
}

void log_times(const std::vector<StageTime>& stages, const LogSink& log) {
  if (!log) return;
  for (const StageTime& stage : stages) {
    log(3,
        fmt::format("{}: {:.2f} s, {:.1f} core s", stage.name, stage.seconds, stage.core_seconds));
  }
}

}  // namespace stgs::encoder
