// SPDX-License-Identifier: Apache-2.0
#include "tasks.h"

#include "structs.h"

namespace stgs::sdk {
namespace {

constexpr std::uint32_t kMaxThreads = 1024;

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

stgs_result check_task_runner(const stgs_task_runner* runner, const Log& log) {
  if (runner == nullptr) return STGS_OK;
  stgs_task_runner known{};
  if (const stgs_result bad = copy_in(runner, known); bad != STGS_OK) return bad;
  if (known.run != nullptr && known.threads >= 1 && known.threads <= kMaxThreads) return STGS_OK;
  log(STGS_LOG_ERROR, known.run == nullptr
                          ? "settings: task_runner has no `run`"
                          : "settings: task_runner.threads is out of range (expected 1 to 1024)");
  return STGS_ERROR_ARGUMENT;
}

std::unique_ptr<TaskRunner> caller_tasks(const stgs_task_runner* runner) {
  if (runner == nullptr) return nullptr;
  stgs_task_runner known{};
  (void)copy_in(runner, known);
  return std::make_unique<CallerTasks>(known);
}

}  // namespace stgs::sdk
