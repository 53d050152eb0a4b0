// SPDX-License-Identifier: Apache-2.0
// Measures how long the stages of a task take.
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "stgs/encoder/progress.h"

namespace stgs::encoder {

// The duration of a stage.
struct StageTime {
  std::string name;
  double seconds = 0;       // elapsed
  double core_seconds = 0;  // computed by all threads of the process
};

// One thread at a time.
class StageClock {
 public:
  // Starts a stage, which ends the one before. A stage that continues has one duration.
  void begin(const std::string& name);
  // Returns the seconds since the stage began.
  double seconds() const;
  const std::string& stage() const { return name_; }
  // Returns the times of all stages, in the order of their first begin, with the current one.
  std::vector<StageTime> times() const;

 private:
  std::string name_;  // empty before the first stage
  std::chrono::steady_clock::time_point start_;
  double core_start_ = 0;
  std::vector<StageTime> done_;
};

// Logs a line per stage, for debugging. `log` may be null.
void log_times(const std::vector<StageTime>& stages, const LogSink& log);

}  // namespace stgs::encoder
