// SPDX-License-Identifier: Apache-2.0
// Runs an external program (COLMAP) without a shell.
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Runs arguments[0], found in PATH, with its output in the file `log_path`. Blocks until it ends.
// Reports `stage` and `done` to `progress` every 50 ms from the calling thread, with the program as
// the detail. Kills the program and its children when `progress` cancels and at the deadline. Files
// that it writes are limited to 64 GiB. If `exit_code` is not null, it becomes the exit code, or -1
// if the program did not exit by itself.
// kNotBuilt if the program is not installed; kRuntime if it cannot be started, is cancelled or
// fails (with failure_reason()).
Status run_program(const std::vector<std::string>& arguments, const std::string& log_path,
                   const std::string& stage, double done, const ProgressSink& progress,
                   std::chrono::steady_clock::time_point deadline, int* exit_code = nullptr);

// Returns the reason for a failure from the last MiB of the output of a program: ": REASON" from
// its last error line in the format of COLMAP or glog, else its last lines.
std::string failure_reason(const std::string& log_path);

}  // namespace stgs::encoder
