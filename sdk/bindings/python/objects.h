// SPDX-License-Identifier: Apache-2.0
// Shared by the classes of the Python module: errors, the log, and calls without the GIL.
#pragma once

#include <pybind11/pybind11.h>

#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "stgs/stgs.h"

namespace stgs::python {

namespace py = pybind11;

// Becomes stgs.Error in Python.
struct Failure : std::runtime_error {
  stgs_result code = STGS_OK;
  int issue = 0;
  std::optional<std::uint64_t> offset;

  Failure(stgs_result result, const std::string& message)
      : std::runtime_error(message), code(result) {}
  explicit Failure(const stgs_error& error) : Failure(error.result, error.message) {
    issue = error.issue;
    if (error.offset != STGS_NO_OFFSET) offset = error.offset;
  }
};

// Returns a zeroed struct with its size set.
template <typename T>
T sized() {
  T out{};
  out.struct_size = sizeof out;
  return out;
}

// Throws Failure if a call on an object failed. `get_error` is the _error function of the object.
template <typename Object>
void check(stgs_result result, const Object* object,
           stgs_result (*get_error)(const Object*, stgs_error*)) {
  if (result == STGS_OK) return;
  auto error = sized<stgs_error>();
  if (get_error(object, &error) == STGS_OK && error.result == result) throw Failure(error);
  throw Failure(result, stgs_result_name(result));
}

// Collects the log of a call and passes it to Python's logging afterwards. No Python code runs
// during a call, so none can call back into the object.
class Log {
 public:
  // An stgs_log_fn; `self` is the Log.
  static void append(void* self, stgs_log_level level, const char* message) {
    Log& log = *static_cast<Log*>(self);
    const std::scoped_lock lock(log.mutex_);
    log.messages_.emplace_back(level, message);
  }
  // Requires the GIL.
  void flush() {
    std::vector<std::pair<stgs_log_level, std::string>> messages;
    {
      const std::scoped_lock lock(mutex_);
      messages.swap(messages_);
    }
    if (messages.empty()) return;
    const py::object logger = py::module_::import("logging").attr("getLogger")("stgs");
    for (const auto& [level, message] : messages) {
      const char* name = level == STGS_LOG_ERROR     ? "error"
                         : level == STGS_LOG_WARNING ? "warning"
                                                     : "info";
      logger.attr(name)("%s", message);
    }
  }

 private:
  std::mutex mutex_;  // other threads may be in a call
  std::vector<std::pair<stgs_log_level, std::string>> messages_;
};

// Runs a call without the GIL and with the locks of its objects: Python threads may share an
// object, but the library allows one thread at a time.
template <typename Call, typename... Mutexes>
auto unlocked(Call&& call, Mutexes&... mutexes) {
  const py::gil_scoped_release release;
  const std::scoped_lock lock(mutexes...);
  return call();
}

}  // namespace stgs::python
