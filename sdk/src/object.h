// SPDX-License-Identifier: Apache-2.0
// Shared by all objects of the C interface: the last error, the log, and the boundary that no
// exception crosses.
#pragma once

#include <array>
#include <cstring>
#include <exception>
#include <new>
#include <string>

#include "stgs/format/status.h"
#include "stgs/stgs.h"

namespace stgs::sdk {

// A Status, or a result that only the SDK has.
struct Outcome {
  stgs_result result = STGS_OK;
  Status status;  // carries the message; its code is irrelevant if it was built from `r`

  Outcome() = default;
  Outcome(Status s);  // NOLINT: implicit by design
  Outcome(stgs_result r, std::string message)
      : result(r), status(StatusCode::kRuntime, std::move(message)) {}
};

// Maps a status to a result. Does not allocate.
stgs_result result_of(StatusCode code, const std::string& message);

// The last error of an object. Does not allocate, so that it can report a lack of memory.
class LastError {
 public:
  stgs_result set(stgs_result result, const char* message);
  stgs_result set(const Outcome& outcome);
  // Writes the error to the caller's struct.
  stgs_result get(stgs_error* error) const;

 private:
  stgs_result result_ = STGS_OK;
  int issue_ = 0;
  std::uint64_t offset_ = STGS_NO_OFFSET;
  std::array<char, 8192> message_{};
};

// The caller's log; does nothing without a function.
struct Log {
  stgs_log_fn function = nullptr;
  void* user = nullptr;

  void operator()(stgs_log_level level, const char* message) const {
    if (function != nullptr) function(user, level, message);
  }
  void operator()(stgs_log_level level, const std::string& message) const {
    (*this)(level, message.c_str());
  }
};

// Runs a call on an object, stores its outcome in object->error and returns the result. Exceptions
// become results.
template <typename Object, typename Call>
stgs_result guarded(Object* object, Call&& call) noexcept {
  if (object == nullptr) return STGS_ERROR_ARGUMENT;
  try {
    return object->error.set(call());
  } catch (const std::bad_alloc&) {
    return object->error.set(STGS_ERROR_OUT_OF_MEMORY, "out of memory");
  } catch (const std::exception& e) {
    return object->error.set(STGS_ERROR_RUNTIME, e.what());
  } catch (...) {
    return object->error.set(STGS_ERROR_RUNTIME, "unknown exception");
  }
}

}  // namespace stgs::sdk

// Like STGS_TRY, for an Outcome or Status in a function that returns an Outcome.
#define STGS_SDK_TRY(expression)                                                            \
  do {                                                                                      \
    if (::stgs::sdk::Outcome stgs_outcome_ = (expression); stgs_outcome_.result != STGS_OK) \
      return stgs_outcome_;                                                                 \
  } while (false)
