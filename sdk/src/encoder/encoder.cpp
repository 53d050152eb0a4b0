// SPDX-License-Identifier: Apache-2.0
#include "encoder/encoder.h"

#include <algorithm>

namespace stgs::sdk {
namespace {

stgs_log_level level_of(int level) {
  return level <= 0 ? STGS_LOG_ERROR : level == 1 ? STGS_LOG_WARNING : STGS_LOG_INFO;
}

// Reports progress to the caller until the call is cancelled.
class ProgressReporter {
 public:
  explicit ProgressReporter(const stgs_encoder& encoder) : encoder_(encoder) {}

  bool cancelled() const { return cancelled_; }
  bool should_continue(const encoder::Progress& progress) {
    const stgs_encoder_settings& settings = encoder_.settings;
    cancelled_ = cancelled_ || encoder_.cancelled;
    if (!cancelled_ && settings.progress != nullptr) {
      const stgs_encoder_progress current = to_c(progress);
      cancelled_ = settings.progress(settings.progress_user, &current) != 0;
    }
    return !cancelled_;
  }

 private:
  stgs_encoder_progress to_c(const encoder::Progress& progress) {
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
  bool cancelled_ = false;
  std::string stage_;
  double done_ = 0;
};

stgs_encoder_settings default_encoder_settings() {
  stgs_encoder_settings settings{};
  settings.struct_size = sizeof(settings);
  return settings;
}

}  // namespace

std::unique_ptr<TaskRunner> make_thread_pool(std::uint32_t threads) {
  if (threads == 0) return nullptr;
  return std::make_unique<ThreadPool>(static_cast<int>(threads));
}

encoder::LogSink log_sink(const Log& log) {
  return [log](int level, const std::string& line) {
    constexpr int kDebug = 3;
    if (level < kDebug) log(level_of(level), line);
  };
}

Outcome run_work(stgs_encoder& encoder, const EncoderWork& work) {
  if (encoder.cancelled) {
    return {STGS_ERROR_CANCELLED, "the encoder was cancelled; create another encoder"};
  }
  const stgs_encoder_settings& settings = encoder.settings;
  ProgressReporter reporter(encoder);
  const encoder::ProgressSink progress = [&](const encoder::Progress& p) {
    return reporter.should_continue(p);
  };
  const encoder::LogSink log = log_sink({settings.log, settings.log_user});
  if (encoder.threads == nullptr) encoder.threads = make_thread_pool(settings.threads);
  const ScopedTaskRunner use(encoder.threads.get());
  Outcome outcome = work(progress, log);
  const bool was_cancelled = reporter.cancelled() && outcome.result == STGS_ERROR_RUNTIME;
  if (was_cancelled) outcome.result = STGS_ERROR_CANCELLED;
  return outcome;
}

Outcome check_range(const char* field, double value, double min, double max) {
  return check_range({field, min, max, ""}, value);
}

Outcome check_range(const Parameter& parameter, double value) {
  if (parameter.accepts(value)) return {};
  return {STGS_ERROR_ARGUMENT, fmt::format("settings: {} is {:.10g} (expected {})", parameter.name,
                                           value, parameter.range())};
}

Outcome check_flag(const char* field, std::int32_t value) {
  if (value == 0 || value == 1) return {};
  return {STGS_ERROR_ARGUMENT, fmt::format("settings: {} is {} (expected 0 or 1)", field, value)};
}

Outcome check_frames(std::int32_t first, std::int32_t end) {
  if (first >= 0 && (end == -1 || end > first)) return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("settings: first_frame is {} and end_frame is {} (expected first_frame >= 0 "
                      "and end_frame > first_frame, or -1 for all frames)",
                      first, end)};
}

Outcome check_backend(stgs_backend backend) {
  if (backend == STGS_BACKEND_VULKAN) {
    return {STGS_ERROR_NOT_BUILT,
            "settings: STGS_BACKEND_VULKAN cannot encode (expected STGS_BACKEND_AUTO, _CPU or "
            "_CUDA)"};
  }
  return check_range("backend", backend, STGS_BACKEND_AUTO, STGS_BACKEND_CUDA);
}

const char* backend_name(stgs_backend backend) {
  constexpr const char* kNames[] = {"auto", "cpu", "cuda"};
  return kNames[backend];
}

Outcome check_preset(stgs_preset preset) {
  return check_range("preset", preset, STGS_PRESET_DEFAULT, STGS_PRESET_BEST);
}

const char* preset_name(stgs_preset preset) {
  constexpr const char* kNames[] = {"default", "fast", "best"};
  return kNames[preset];
}

Outcome check_overrides(const stgs_parameter* parameters, std::uint32_t count) {
  if (count > 0 && parameters == nullptr) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("settings: parameters is NULL, but parameter_count is {}", count)};
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    if (parameters[i].name == nullptr || parameters[i].value == nullptr) {
      return {STGS_ERROR_ARGUMENT,
              fmt::format("settings: parameters[{}] has a NULL name or value", i)};
    }
  }
  return {};
}

std::vector<std::pair<std::string, std::string>> overrides_of(const stgs_parameter* parameters,
                                                              std::uint32_t count) {
  std::vector<std::pair<std::string, std::string>> out;
  for (std::uint32_t i = 0; i < count; ++i)
    out.emplace_back(parameters[i].name, parameters[i].value);
  return out;
}

Outcome check_text(const char* field, const char* text) {
  constexpr std::size_t kMaxBytes = 4096;
  const std::size_t bytes = text_of(text).size();
  if (bytes <= kMaxBytes) return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("settings: {} has {} bytes (expected at most {})", field, bytes, kMaxBytes)};
}

Outcome check_path(const char* argument, const char* path) {
  if (path != nullptr && *path != '\0') return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("{} is {} (expected a path)", argument, path == nullptr ? "NULL" : "empty")};
}

}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_encoder_settings_defaults(stgs_encoder_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, stgs::sdk::default_encoder_settings());
}

stgs_result stgs_encoder_create(const stgs_encoder_settings* settings, stgs_encoder** out) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  *out = nullptr;
  stgs_encoder_settings known = stgs::sdk::default_encoder_settings();
  if (settings != nullptr) {
    if (const stgs_result bad = stgs::sdk::copy_in(settings, known); bad != STGS_OK) return bad;
  }
  if (known.threads > stgs::sdk::kMaxThreads) return STGS_ERROR_ARGUMENT;
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
  return encoder == nullptr ? STGS_ERROR_ARGUMENT : encoder->error.get(error);
}

void stgs_encoder_cancel(stgs_encoder* encoder) {
  if (encoder != nullptr) encoder->cancelled = true;
}

}  // extern "C"
