// SPDX-License-Identifier: Apache-2.0
// How long work tells its caller where it is.
#pragma once

#include <functional>
#include <string>

namespace stgs::encoder {

struct Progress {
  std::string stage;        // "calibrate", "flow", "train", ...
  double done = 0;          // 0..1 of this stage
  double eta_seconds = -1;  // of this stage; negative: unknown
  std::string detail;       // for a person: loss, counts
};

// Called on the thread that started the work; returns false to cancel.
using ProgressSink = std::function<bool(const Progress&)>;

// One line for a person; level 0 errors, 1 warnings, 2 information, 3 details.
using LogSink = std::function<void(int level, const std::string& line)>;

}  // namespace stgs::encoder
