// SPDX-License-Identifier: Apache-2.0
// What the calls of an encoder share: how they are watched and stopped, and how their settings are
// refused.
#pragma once

#include <atomic>
#include <functional>
#include <string>

#include "object.h"
#include "stgs/encoder/progress.h"
#include "stgs/stgs_encoder.h"
#include "structs.h"

struct stgs_encoder {
  stgs::sdk::LastError error;
  stgs_encoder_settings settings{};
  std::atomic<bool> cancelled{false};
  static_assert(std::atomic<bool>::is_always_lock_free, "set by signal handlers");
};

namespace stgs::sdk {

inline constexpr std::uint32_t kMostThreads = 1024;

// Runs `work` on so many threads at most; 0: all cores.
void run_on(std::uint32_t threads, const std::function<void()>& work);

// Which threads a piece of work is held to.
enum class ThreadLimit { kOwn, kProcess };

// Runs `work` with an encoder's threads, progress and log: STGS_ERROR_CANCELLED where it was
// stopped and ended for that.
using EncoderWork =
    std::function<Outcome(const encoder::ProgressSink& progress, const encoder::LogSink& log)>;
Outcome run_work(stgs_encoder& encoder, ThreadLimit limit, const EncoderWork& work);

// STGS_ERROR_ARGUMENT, which names the field and what is possible, unless value is in [least, most]
// or, where `zero` says what that means, 0.
Outcome check_range(const char* field, double value, double least, double most,
                    const char* zero = nullptr);
// The same for a field that is 0 or 1.
Outcome check_flag(const char* field, std::int32_t value);
// For a pair of fields: a range that is not empty; an end of -1 is open.
Outcome check_frames(std::int32_t first, std::int32_t end);
// For a path that there must be.
Outcome check_path(const char* argument, const char* path);

// Text of the caller's; NULL is none.
inline std::string text_of(const char* text) {
  return text == nullptr ? std::string() : std::string(text);
}

// The caller's settings over `known`, the defaults; NULL: these.
template <typename Settings>
Outcome take_settings(const Settings* given, Settings& known) {
  return given == nullptr ? Outcome() : take_struct(given, known, "settings");
}
// A report may be NULL.
template <typename Report>
Outcome check_report(const Report* report) {
  return report == nullptr ? Outcome() : check_struct(report, "report");
}

}  // namespace stgs::sdk
