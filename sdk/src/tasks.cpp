// SPDX-License-Identifier: Apache-2.0
#include "tasks.h"

namespace stgs::sdk {
namespace {

constexpr std::uint32_t kMostThreads = 1024;

class CallerTasks final : public TaskRunner {
 public:
  explicit CallerTasks(const stgs_task_runner& runner) : runner_(runner) {}

  int threads() const override { return static_cast<int>(runner_.threads); }
  void run(void (*work)(void* argument), void* argument, int count) override {
    runner_.run(runner_.user, work, argument, static_cast<std::uint32_t>(count));
  }

 private:
  const stgs_task_runner runner_;
};

}  // namespace

stgs_result check_task_runner(const stgs_task_runner* runner) {
  if (runner == nullptr) return STGS_OK;
  if (const stgs_result bad = check_struct(runner); bad != STGS_OK) return bad;
  const bool usable =
      runner->run != nullptr && runner->threads >= 1 && runner->threads <= kMostThreads;
  return usable ? STGS_OK : STGS_ERROR_ARGUMENT;
}

std::unique_ptr<TaskRunner> caller_tasks(const stgs_task_runner* runner) {
  return runner == nullptr ? nullptr : std::make_unique<CallerTasks>(*runner);
}

}  // namespace stgs::sdk
