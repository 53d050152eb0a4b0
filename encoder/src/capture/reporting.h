// SPDX-License-Identifier: Apache-2.0
// Progress from parallel work: workers count, and the thread that started the work reports.
#pragma once

#include <atomic>
#include <functional>
#include <string>

#include "stgs/encoder/progress.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Shared by the workers of one stage.
struct Counter {
  std::atomic<std::uint64_t> done{0};
  std::atomic<bool> cancelled{false};
};

// Runs `work` on a thread of its own and tells `progress` about counter.done of `total` from the
// calling thread, some times a second. A cancelled run is an error even if `work` finished; an
// exception of `work` becomes one.
Status run_reporting(const std::string& stage, std::uint64_t total, const ProgressSink& progress,
                     const std::function<Status(Counter&)>& work);

}  // namespace stgs::encoder
