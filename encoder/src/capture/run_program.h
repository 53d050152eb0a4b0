// SPDX-License-Identifier: Apache-2.0
// Running another program (COLMAP), without a shell.
#pragma once

#include <string>
#include <vector>

#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Runs arguments[0], looked for in PATH, with its output in the file `log_path`, and waits for it.
// Reports `stage` some times a second from the calling thread, with the program as the detail; when
// that cancels, ends the program. Errors: not installed (kNotBuilt), cancelled, or an exit code but
// 0 (with the program's own last error line or, where it wrote none, the last lines of the output).
// `exit_code`, if asked for, becomes the program's, or -1 if it did not end by itself.
Status run_program(const std::vector<std::string>& arguments, const std::string& log_path,
                   const std::string& stage, double done, const ProgressSink& progress,
                   int* exit_code = nullptr);

// What a program's output says of why it failed: its last error line (": REASON", as COLMAP and its
// logging library write it), else its last lines.
std::string failure_reason(const std::string& log_path);

}  // namespace stgs::encoder
