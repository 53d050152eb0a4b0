// SPDX-License-Identifier: Apache-2.0
// The caller's threads as a TaskRunner.
#pragma once

#include <memory>

#include "object.h"
#include "stgs/format/task_runner.h"

namespace stgs::sdk {

// STGS_OK where there is none, and where it can be used.
stgs_result check_task_runner(const stgs_task_runner* runner, const Log& log);
// Null where there is none. One that has been checked.
std::unique_ptr<TaskRunner> caller_tasks(const stgs_task_runner* runner);

}  // namespace stgs::sdk
