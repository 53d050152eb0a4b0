// SPDX-License-Identifier: Apache-2.0
#include "reporting.h"

#include <algorithm>
#include <chrono>
#include <future>

#include "stgs/format/task_runner.h"

namespace stgs::encoder {

Status run_reporting(const std::string& stage, std::uint64_t total, const ProgressSink& progress,
                     const std::function<Status(Counter&)>& work) {
  using Clock = std::chrono::steady_clock;
  Counter counter;
  std::future<Status> result =
      std::async(std::launch::async, [&, runner = task_runner()]() -> Status {
        const ScopedTaskRunner use(runner);
        try {
          return work(counter);
        } catch (const std::exception& error) {
          return runtime_error("{}: {}", stage, error.what());
        }
      });
  const auto start = Clock::now();
  const auto report = [&] {
    const double share =
        static_cast<double>(counter.done) / static_cast<double>(std::max<std::uint64_t>(total, 1));
    const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
    const double eta = share > 0 ? seconds * (1 - share) / share : -1;
    const std::string detail = fmt::format("{} of {}", counter.done.load(), total);
    if (progress && !progress({stage, std::min(share, 1.0), eta, detail})) counter.cancelled = true;
  };
  while (result.wait_for(std::chrono::milliseconds(100)) != std::future_status::ready) report();
  Status status = result.get();
  if (status.ok()) report();
  if (counter.cancelled) return runtime_error("{}: cancelled", stage);
  return status;
}

}  // namespace stgs::encoder
