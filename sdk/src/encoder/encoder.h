// SPDX-License-Identifier: Apache-2.0
// Shared by the calls of an encoder: progress, cancellation and checks of settings.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "object.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/parameter.h"
#include "stgs/format/thread_pool.h"
#include "stgs/stgs_encoder.h"
#include "structs.h"

struct stgs_encoder {
  stgs::sdk::LastError error;
  stgs_encoder_settings settings{};
  std::unique_ptr<stgs::TaskRunner> threads;  // created by the first call; null: the default pool
  std::atomic<bool> cancelled{false};
  static_assert(std::atomic<bool>::is_always_lock_free, "signal handlers set it");
};

namespace stgs::sdk {

inline constexpr std::uint32_t kMaxThreads = 1024;

// Returns a pool of `threads` threads; null for 0: the default pool.
std::unique_ptr<TaskRunner> make_thread_pool(std::uint32_t threads);

// Returns a sink for the caller's log, which receives no debug lines.
encoder::LogSink log_sink(const Log& log);

// Runs `work` with the threads, progress and log of an encoder. Returns STGS_ERROR_CANCELLED if it
// failed because it was cancelled.
using EncoderWork =
    std::function<Outcome(const encoder::ProgressSink& progress, const encoder::LogSink& log)>;
Outcome run_work(stgs_encoder& encoder, const EncoderWork& work);

// Returns STGS_ERROR_ARGUMENT, naming the field and its range, unless the value is in [min, max].
Outcome check_range(const char* field, double value, double min, double max);
// Returns STGS_ERROR_ARGUMENT, naming the parameter and its range, unless it accepts the value.
Outcome check_range(const Parameter& parameter, double value);
// Checks all numbers of a struct that a table describes.
template <typename Table, typename Settings>
Outcome check_ranges(const Settings& settings) {
  Outcome outcome;
  Table::for_each([&](const Parameter& parameter, auto member) {
    if (outcome.result != STGS_OK) return;
    outcome = check_range(parameter, static_cast<double>(member(settings)));
  });
  return outcome;
}
// Checks that a field is 0 or 1.
Outcome check_flag(const char* field, std::int32_t value);
// Checks that a range of frames is not empty; an end of -1 is open.
Outcome check_frames(std::int32_t first, std::int32_t end);
// Checks the backend of an encoder, and returns its name.
Outcome check_backend(stgs_backend backend);
const char* backend_name(stgs_backend backend);
// Checks a preset, and returns its name.
Outcome check_preset(stgs_preset preset);
const char* preset_name(stgs_preset preset);
// Checks that overrides of hyperparameters are complete, and returns them.
Outcome check_overrides(const stgs_parameter* parameters, std::uint32_t count);
std::vector<std::pair<std::string, std::string>> overrides_of(const stgs_parameter* parameters,
                                                              std::uint32_t count);
// Checks that a path is neither NULL nor empty.
Outcome check_path(const char* argument, const char* path);

// Checks that a text of the metadata is not too long.
Outcome check_text(const char* field, const char* text);
// Returns the caller's text; NULL is empty.
inline std::string text_of(const char* text) {
  return text == nullptr ? std::string() : std::string(text);
}

// Reads the caller's settings into `known`, which holds the defaults; NULL leaves them.
template <typename Settings>
Outcome copy_in_settings(const Settings* given, Settings& known) {
  return given == nullptr ? Outcome() : copy_in(given, known, "settings");
}
// Checks the struct_size of a report; NULL is valid.
template <typename Report>
Outcome check_report(const Report* report) {
  return report == nullptr ? Outcome() : check_struct(report, "report");
}

}  // namespace stgs::sdk
