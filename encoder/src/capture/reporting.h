// SPDX-License-Identifier: Apache-2.0
// Progress of parallel work: workers count, and the calling thread reports.
#pragma once

#include <atomic>
#include <functional>
#include <string>

#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// State shared by the workers of one stage.
struct Counter {
  std::atomic<std::uint64_t> done{0};  // finished items
  std::atomic<bool> cancelled{false};  // the workers should return
};

// Runs `work` on another thread and blocks until it returns. Meanwhile calls `progress` from the
// calling thread every 100 ms with counter.done of `total`. Returns kRuntime for an exception, and
// for a cancelled run even if `work` finished.
Status run_reporting(const std::string& stage, std::uint64_t total, const ProgressSink& progress,
                     const std::function<Status(Counter&)>& work);

}  // namespace stgs::encoder
