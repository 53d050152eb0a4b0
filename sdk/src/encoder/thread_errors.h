// SPDX-License-Identifier: Apache-2.0
// The last error of each thread that uses an object.
#pragma once

#include <mutex>
#include <thread>
#include <unordered_map>

#include "object.h"

namespace stgs::sdk {

// Like LastError, for an object that several threads use at once. Thread-safe.
class ThreadErrors {
 public:
  stgs_result set(stgs_result result, const char* message) noexcept {
    LastError* error = of_thread();
    return error == nullptr ? result : error->set(result, message);
  }
  stgs_result set(const Outcome& outcome) noexcept {
    LastError* error = of_thread();
    return error == nullptr ? outcome.result : error->set(outcome);
  }
  // Writes the error of the calling thread; STGS_OK if it has made no call.
  stgs_result get(stgs_error* error) const {
    const std::lock_guard lock(mutex_);
    const auto found = errors_.find(std::this_thread::get_id());
    static const LastError kNone;
    return (found == errors_.end() ? kNone : found->second).get(error);
  }

 private:
  // Returns null without memory: then the message is lost. The address stays valid.
  LastError* of_thread() noexcept {
    try {
      const std::lock_guard lock(mutex_);
      return &errors_[std::this_thread::get_id()];
    } catch (const std::bad_alloc&) {
      return nullptr;
    }
  }

  mutable std::mutex mutex_;
  std::unordered_map<std::thread::id, LastError> errors_;
};

}  // namespace stgs::sdk
