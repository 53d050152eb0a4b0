// SPDX-License-Identifier: Apache-2.0
// Errors as values. No exception crosses a module boundary.
#pragma once

#include <fmt/format.h>

#include <exception>
#include <new>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

namespace stgs {

// Error codes. The values are the exit codes of the command line, except where stated.
enum class StatusCode : int {
  kOk = 0,           // success
  kUsage = 1,        // invalid argument or call
  kIo = 2,           // a file or stream could not be read or written
  kInvalidFile = 3,  // malformed, or not the expected kind of input
  kRuntime = 4,      // any other failure at run time
  kUnsupported = 5,  // well-formed, but not supported
  kNotBuilt = 6,     // needs a feature that this build lacks
  kDiffers = 7,      // a comparison found a difference
  kNoMemory = 8,     // out of memory; exit code of kRuntime
  kLimit = 9,        // exceeds a limit set by the caller; exit code of kUnsupported
  kDeviceLost = 10,  // the GPU has failed; recreate the objects that use it; exit code of kRuntime
};

// Returns the code of an exception: kNoMemory for std::bad_alloc, else kRuntime.
inline StatusCode code_of(const std::exception& e) {
  return dynamic_cast<const std::bad_alloc*>(&e) != nullptr ? StatusCode::kNoMemory
                                                            : StatusCode::kRuntime;
}

// Returns whether a part of a file cannot be used because of its content: another attempt fails the
// same way.
inline bool is_damage(StatusCode code) {
  return code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported;
}

// The result of an operation: kOk, or a code with a message for the user (PATH: problem; remedy).
class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(StatusCode code, std::string message) : code_(code), message_(std::move(message)) {}

  bool ok() const { return code_ == StatusCode::kOk; }
  StatusCode code() const { return code_; }
  const std::string& message() const { return message_; }

 private:
  StatusCode code_ = StatusCode::kOk;
  std::string message_;
};

// A value, or the Status that explains why there is none. Access the value only if ok().
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}          // NOLINT: implicit by design
  Result(Status status) : status_(std::move(status)) {}  // NOLINT: implicit by design

  bool ok() const { return value_.has_value(); }
  const Status& status() const { return status_; }
  T& value() & { return *value_; }
  const T& value() const& { return *value_; }
  T&& value() && { return std::move(*value_); }
  T* operator->() { return &*value_; }
  const T* operator->() const { return &*value_; }
  T& operator*() { return *value_; }
  const T& operator*() const { return *value_; }

 private:
  std::optional<T> value_;
  Status status_;
};

// The functions below return a Status with the code of their name and a formatted message.
template <typename... Args>
Status usage_error(fmt::format_string<Args...> text, Args&&... args) {
  return {StatusCode::kUsage, fmt::format(text, std::forward<Args>(args)...)};
}
template <typename... Args>
Status io_error(fmt::format_string<Args...> text, Args&&... args) {
  return {StatusCode::kIo, fmt::format(text, std::forward<Args>(args)...)};
}
template <typename... Args>
Status invalid_file(fmt::format_string<Args...> text, Args&&... args) {
  return {StatusCode::kInvalidFile, fmt::format(text, std::forward<Args>(args)...)};
}
template <typename... Args>
Status runtime_error(fmt::format_string<Args...> text, Args&&... args) {
  return {StatusCode::kRuntime, fmt::format(text, std::forward<Args>(args)...)};
}
template <typename... Args>
Status unsupported(fmt::format_string<Args...> text, Args&&... args) {
  return {StatusCode::kUnsupported, fmt::format(text, std::forward<Args>(args)...)};
}
template <typename... Args>
Status not_built(fmt::format_string<Args...> text, Args&&... args) {
  return {StatusCode::kNotBuilt, fmt::format(text, std::forward<Args>(args)...)};
}

// Returns the text of an errno value for messages: "No such file or directory".
inline std::string system_message(int error) {
  return error == 0 ? "unknown error" : std::generic_category().message(error);
}

}  // namespace stgs

// Returns from the enclosing function if `expression`, a Status, is an error.
#define STGS_TRY(expression)                                                                 \
  do {                                                                                       \
    if (::stgs::Status stgs_status_ = (expression); !stgs_status_.ok()) return stgs_status_; \
  } while (false)

#define STGS_CONCAT_INNER(a, b) a##b
#define STGS_CONCAT(a, b) STGS_CONCAT_INNER(a, b)
// STGS_ASSIGN(auto x, make_x()): assigns the value of a Result, or returns its Status from the
// enclosing function.
#define STGS_ASSIGN(target, expression)                    \
  auto STGS_CONCAT(stgs_result_, __LINE__) = (expression); \
  if (!STGS_CONCAT(stgs_result_, __LINE__).ok())           \
    return STGS_CONCAT(stgs_result_, __LINE__).status();   \
  target = std::move(STGS_CONCAT(stgs_result_, __LINE__)).value()
