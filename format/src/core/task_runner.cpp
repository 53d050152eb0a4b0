// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/task_runner.h"

#include <utility>

namespace stgs {
namespace {

thread_local TaskRunner* current = nullptr;

}  // namespace

TaskRunner* task_runner() {
  return current;
}

ScopedTaskRunner::ScopedTaskRunner(TaskRunner* runner) : before_(std::exchange(current, runner)) {}

ScopedTaskRunner::~ScopedTaskRunner() {
  current = before_;
}

}  // namespace stgs
