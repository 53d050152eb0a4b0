// SPDX-License-Identifier: Apache-2.0
// The caller's task runner as a TaskRunner.
#pragma once

#include <memory>

#include "object.h"
#include "stgs/format/task_runner.h"

namespace stgs::sdk {

// Returns STGS_OK for NULL and for a complete task runner.
stgs_result check_task_runner(const stgs_task_runner* runner, const Log& log);
// Returns the wrapper of a task runner that has been checked; null for NULL.
std::unique_ptr<TaskRunner> caller_tasks(const stgs_task_runner* runner);

}  // namespace stgs::sdk
