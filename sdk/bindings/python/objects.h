// SPDX-License-Identifier: Apache-2.0
// Shared by the classes of the Python module: errors, the log, and calls without the GIL.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
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

// A C object that Python may close. Calls on it, also from several Python threads, run one at a
// time and without the GIL.
template <typename T, void (*kDestroy)(T*), stgs_result (*kGetError)(const T*, stgs_error*)>
class Handle {
 public:
  // `name` is for messages: "scene".
  Handle(const char* name, std::shared_ptr<Log> log) : name_(name), log_(std::move(log)) {}
  // NOLINTNEXTLINE(bugprone-exception-escape): terminates if a mutex cannot be locked
  ~Handle() { close(); }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;

  void set(T* object) { object_ = object; }
  bool is_closed() {
    return unlocked([&] { return object_ == nullptr; }, mutex_);
  }
  // Runs call(object, others...) and throws Failure unless it returns STGS_OK. Fails with
  // STGS_ERROR_STATE if one of the objects is closed.
  template <typename Call, typename... Others>
  void run(Call&& call, Others&... others) {
    const std::optional<Failure> failure = unlocked(
        [&]() -> std::optional<Failure> {
          if (object_ == nullptr) return closed();
          std::optional<Failure> other_closed;
          ((others.object_ == nullptr ? void(other_closed = others.closed()) : void()), ...);
          if (other_closed) return other_closed;
          return failure_of(call(object_, others.object_...));
        },
        mutex_, others.mutex_...);
    log_->flush();
    (others.log_->flush(), ...);
    if (failure) throw Failure(*failure);
  }
  // Destroys the object, and forgets others that it owns. Does nothing if it is closed.
  template <typename... Owned>
  void close(Owned&... owned) {
    unlocked(
        [&] {
          ((owned.object_ = nullptr), ...);
          kDestroy(std::exchange(object_, nullptr));
        },
        mutex_, owned.mutex_...);
  }

 private:
  template <typename U, void (*)(U*), stgs_result (*)(const U*, stgs_error*)>
  friend class Handle;

  Failure closed() const { return {STGS_ERROR_STATE, std::string("the ") + name_ + " is closed"}; }
  std::optional<Failure> failure_of(stgs_result result) const {
    if (result == STGS_OK) return {};
    auto error = sized<stgs_error>();
    if (kGetError(object_, &error) == STGS_OK && error.result == result) return Failure(error);
    return Failure(result, stgs_result_name(result));
  }

  const char* name_;
  std::shared_ptr<Log> log_;
  std::mutex mutex_;
  T* object_ = nullptr;  // null: closed
};

using SceneHandle = Handle<stgs_scene, stgs_scene_destroy, stgs_scene_error>;
using RendererHandle = Handle<stgs_renderer, stgs_renderer_destroy, stgs_renderer_error>;
using PlayerHandle = Handle<stgs_player, stgs_player_destroy, stgs_player_error>;

// Adds close(), closed and the context manager to a class with close() and is_closed().
template <typename Class>
void add_closing(Class& type, const char* close_doc) {
  using T = typename Class::type;
  type.def("close", &T::close, close_doc)
      .def_property_readonly("closed", &T::is_closed, "Whether close() was called.")
      .def("__enter__", [](const py::object& self) { return self; })
      .def("__exit__", [](T& self, const py::args&) { self.close(); });
}

// Formats text for __repr__ by the rules of Python.
template <typename... Args>
std::string format(const char* pattern, const Args&... args) {
  return py::str(pattern).format(args...).template cast<std::string>();
}

}  // namespace stgs::python
