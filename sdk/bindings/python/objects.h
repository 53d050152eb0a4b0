// SPDX-License-Identifier: Apache-2.0
// What the classes of the Python module share: errors, the log, and calls without the interpreter's
// lock.
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

// stgs.Error, before it is one of Python's.
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

// A struct of the interface's with its size set.
template <typename T>
T sized() {
  T out{};
  out.struct_size = sizeof out;
  return out;
}

// Throws where a call on an object failed; `tell` is the object's _error function.
template <typename Object>
void check(stgs_result result, const Object* object,
           stgs_result (*tell)(const Object*, stgs_error*)) {
  if (result == STGS_OK) return;
  auto error = sized<stgs_error>();
  if (tell(object, &error) == STGS_OK && error.result == result) throw Failure(error);
  throw Failure(result, stgs_result_name(result));
}

// What the library has logged during a call, for Python's logging after it: no Python runs within a
// call, so none can call back into the object.
class Log {
 public:
  static void take(void* self, stgs_log_level level, const char* message) {
    Log& log = *static_cast<Log*>(self);
    const std::scoped_lock lock(log.mutex_);
    log.messages_.emplace_back(level, message);
  }
  // With the interpreter's lock.
  void pass_on() {
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
  std::mutex mutex_;  // another thread may be in a call meanwhile
  std::vector<std::pair<stgs_log_level, std::string>> messages_;
};

// Runs a call without the interpreter's lock and with those of the objects, since Python's threads
// may use one object at once and the library's must not. The locks are taken in this order alone.
template <typename Call, typename... Mutexes>
auto unlocked(Call&& call, Mutexes&... mutexes) {
  const py::gil_scoped_release release;
  const std::scoped_lock lock(mutexes...);
  return call();
}

}  // namespace stgs::python
