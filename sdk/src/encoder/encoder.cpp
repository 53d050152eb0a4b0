// SPDX-License-Identifier: Apache-2.0
#include "encoder/encoder.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <optional>

namespace stgs::sdk {
namespace {

stgs_log_level level_of(int level) {
  return level <= 0 ? STGS_LOG_ERROR : level == 1 ? STGS_LOG_WARNING : STGS_LOG_INFO;
}

// Tells the caller of progress, until one of them has enough of it.
class Watch {
 public:
  explicit Watch(const stgs_encoder& encoder) : encoder_(encoder) {}

  bool stopped() const { return stopped_; }
  bool go_on(const encoder::Progress& progress) {
    const stgs_encoder_settings& settings = encoder_.settings;
    stopped_ = stopped_ || encoder_.cancelled;
    if (!stopped_ && settings.progress != nullptr) {
      const stgs_encoder_progress told = as_struct(progress);
      stopped_ = settings.progress(settings.progress_user, &told) != 0;
    }
    return !stopped_;
  }

 private:
  stgs_encoder_progress as_struct(const encoder::Progress& progress) {
    const double before = progress.stage == stage_ ? done_ : 0.0;
    stage_ = progress.stage;
    done_ = std::max(before, std::clamp(progress.done, 0.0, 1.0));
    stgs_encoder_progress out{};
    out.struct_size = sizeof(out);
    out.stage = progress.stage.c_str();
    out.done = done_;
    out.eta_seconds = progress.eta_seconds;
    out.detail = progress.detail.c_str();
    if (const auto& training = progress.training) {
      out.iteration = training->iteration;
      out.iterations = training->iterations;
      out.primitives = training->primitives;
      out.loss = training->loss;
      out.held_out_psnr = training->held_out_psnr.value_or(0.0);
    }
    return out;
  }

  const stgs_encoder& encoder_;
  bool stopped_ = false;
  std::string stage_;
  double done_ = 0;
};

stgs_encoder_settings default_settings() {
  stgs_encoder_settings settings{};
  settings.struct_size = sizeof(settings);
  return settings;
}

}  // namespace

void run_on(std::uint32_t threads, const std::function<void()>& work) {
  if (threads == 0) {
    work();
  } else {
    tbb::task_arena(static_cast<int>(threads)).execute(work);
  }
}

Outcome run_work(stgs_encoder& encoder, ThreadLimit limit, const EncoderWork& work) {
  if (encoder.cancelled) {
    return {STGS_ERROR_CANCELLED, "the encoder was cancelled before: make another one"};
  }
  const stgs_encoder_settings& settings = encoder.settings;
  Watch watch(encoder);
  const encoder::ProgressSink progress = [&](const encoder::Progress& p) { return watch.go_on(p); };
  const Log to{settings.log, settings.log_user};
  const encoder::LogSink log = [&](int level, const std::string& line) {
    constexpr int kDetails = 3;
    if (level < kDetails) to(level_of(level), line);
  };
  Outcome outcome;
  const auto run = [&] { outcome = work(progress, log); };
  if (limit == ThreadLimit::kProcess && settings.threads > 0) {
    const tbb::global_control held(tbb::global_control::max_allowed_parallelism, settings.threads);
    run();
  } else {
    run_on(settings.threads, run);
  }
  const bool ended_for_that = watch.stopped() && outcome.result == STGS_ERROR_RUNTIME;
  if (ended_for_that) outcome.result = STGS_ERROR_CANCELLED;
  return outcome;
}

Outcome check_range(const char* field, double value, double least, double most, const char* zero) {
  if (zero != nullptr && value == 0) return {};
  if (value >= least && value <= most) return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("settings: {} is {:.10g}; it can be {}{:.10g} to {:.10g}", field, value,
                      zero == nullptr ? "" : fmt::format("0 ({}) or ", zero), least, most)};
}

Outcome check_flag(const char* field, std::int32_t value) {
  if (value == 0 || value == 1) return {};
  return {STGS_ERROR_ARGUMENT, fmt::format("settings: {} is {}; it can be 0 or 1", field, value)};
}

Outcome check_frames(std::int32_t first, std::int32_t end) {
  if (first >= 0 && (end == -1 || end > first)) return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("settings: first_frame is {} and end_frame {}; first_frame can be 0 or more, "
                      "end_frame greater than it, or -1 (to the end)",
                      first, end)};
}

Outcome check_path(const char* argument, const char* path) {
  if (path != nullptr && *path != '\0') return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("{} is {}: give a path", argument, path == nullptr ? "NULL" : "empty")};
}

}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_encoder_settings_defaults(stgs_encoder_settings* settings, size_t struct_size) {
  return stgs::sdk::put_defaults(settings, struct_size, stgs::sdk::default_settings());
}

stgs_result stgs_encoder_create(const stgs_encoder_settings* settings, stgs_encoder** out) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  *out = nullptr;
  stgs_encoder_settings known = stgs::sdk::default_settings();
  if (settings != nullptr) {
    if (const stgs_result bad = stgs::sdk::take_struct(settings, known); bad != STGS_OK) return bad;
  }
  if (known.threads > stgs::sdk::kMostThreads) return STGS_ERROR_ARGUMENT;
  auto* encoder = new (std::nothrow) stgs_encoder;
  if (encoder == nullptr) return STGS_ERROR_OUT_OF_MEMORY;
  encoder->settings = known;
  *out = encoder;
  return STGS_OK;
}

void stgs_encoder_destroy(stgs_encoder* encoder) {
  delete encoder;
}

stgs_result stgs_encoder_error(const stgs_encoder* encoder, stgs_error* error) {
  return encoder == nullptr ? STGS_ERROR_ARGUMENT : encoder->error.tell(error);
}

void stgs_encoder_cancel(stgs_encoder* encoder) {
  if (encoder != nullptr) encoder->cancelled = true;
}

}  // extern "C"
