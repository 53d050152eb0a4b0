// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/train.h"

#include <deque>
#include <filesystem>

#include "encoder/encoder.h"
#include "stgs/format/output_path.h"
#include "stgs/format/temporary.h"

namespace stgs::sdk {
namespace {

stgs_train_settings default_train_settings() {
  const encoder::TrainSettings defaults;
  stgs_train_settings settings{};
  settings.struct_size = sizeof(settings);
  copy_parameters<encoder::TrainParameters>(defaults, settings);
  settings.seed = defaults.seed;
  return settings;
}

Outcome check(const stgs_train_settings& s) {
  STGS_SDK_TRY(check_preset(s.preset));
  STGS_SDK_TRY(check_backend(s.backend));
  STGS_SDK_TRY(check_ranges<encoder::TrainParameters>(s));
  STGS_SDK_TRY(check_flag("allow_outside", s.allow_outside));
  STGS_SDK_TRY(check_flag("refine_cameras", s.refine_cameras));
  STGS_SDK_TRY(check_flag("refine_timing", s.refine_timing));
  STGS_SDK_TRY(check_flag("foreground", s.foreground));
  return check_overrides(s.parameters, s.parameter_count);
}

encoder::TrainSettings training_of(const stgs_train_settings& s) {
  encoder::TrainSettings settings;
  settings.preset = preset_name(s.preset);
  settings.backend = backend_name(s.backend);
  copy_parameters<encoder::TrainParameters>(s, settings);
  settings.seed = s.seed;
  settings.checkpoint = text_of(s.checkpoint);
  settings.resume = text_of(s.resume);
  settings.log_path = text_of(s.log_path);
  settings.frame_memory = s.frame_memory;
  settings.perceptual_weights = text_of(s.perceptual_weights);
  settings.refine_cameras = s.refine_cameras != 0;
  settings.refine_timing = s.refine_timing != 0;
  settings.foreground = s.foreground != 0;
  settings.overrides = overrides_of(s.parameters, s.parameter_count);
  return settings;
}

// Checks that the output paths are writable and distinct, and adds their locks. `resume` may equal
// `checkpoint`.
Status claim_paths(const std::string& scene, const encoder::TrainSettings& settings,
                   std::deque<OutputLock>& locks, const encoder::LogSink& log) {
  std::vector<NamedPath> paths = {
      {"scene", scene}, {"checkpoint", settings.checkpoint}, {"log_path", settings.log_path}};
  if (check_distinct({paths[1], {"resume", settings.resume}}).ok()) {
    paths.push_back({"resume", settings.resume});
  }
  STGS_TRY(check_distinct(paths));
  for (const std::string* path : {&scene, &settings.checkpoint, &settings.log_path}) {
    if (!path->empty()) STGS_TRY(prepare_output(*path, locks.emplace_back(), log));
  }
  return {};
}

Status train(const char* prepared, const std::string& scene, const stgs_train_settings& s,
             const encoder::ProgressSink& progress, const encoder::LogSink& log,
             encoder::TrainReport& report) {
  const encoder::TrainSettings settings = training_of(s);
  std::deque<OutputLock> locks;
  STGS_TRY(claim_paths(scene, settings, locks, log));
  STGS_ASSIGN(const encoder::PreparedCapture capture,
              encoder::read_prepared_capture(prepared, s.allow_outside != 0));
  STGS_ASSIGN(const Scene trained, encoder::train(capture, settings, progress, log, &report));
  WriteSettings writing;
  writing.profile = Profile::kLossless;
  return write_scene(scene, trained, writing);
}

Outcome to_c(const encoder::TrainReport& from, const char* scene, stgs_train_report* to) {
  stgs_train_report report{};
  std::error_code error;
  report.bytes = std::filesystem::file_size(scene, error);
  if (error) return io_error("{}: cannot read the file: {}", scene, error.message());
  report.backend = from.backend.rfind("cpu", 0) == 0 ? STGS_BACKEND_CPU : STGS_BACKEND_CUDA;
  report.iterations = static_cast<std::uint64_t>(from.iterations);
  report.primitives = from.primitives;
  report.seconds = from.seconds;
  report.loss = from.final_loss;
  report.held_out_psnr = from.held_out ? from.held_out->psnr : 0.0;
  report.held_out_images = from.held_out ? static_cast<std::uint32_t>(from.held_out->images) : 0;
  copy_out(to, report);
  return {};
}

}  // namespace
}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_train_settings_defaults(stgs_train_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, stgs::sdk::default_train_settings());
}

stgs_result stgs_encoder_train(stgs_encoder* encoder, const char* prepared, const char* scene,
                               const stgs_train_settings* settings, stgs_train_report* report) {
  using namespace stgs::sdk;
  return guarded(encoder, [&]() -> Outcome {
    STGS_SDK_TRY(check_path("prepared", prepared));
    STGS_SDK_TRY(check_path("scene", scene));
    STGS_SDK_TRY(check_report(report));
    stgs_train_settings known = default_train_settings();
    STGS_SDK_TRY(copy_in_settings(settings, known));
    STGS_SDK_TRY(check(known));
    stgs::encoder::TrainReport trained;
    STGS_SDK_TRY(run_work(*encoder, [&](const auto& progress, const auto& log) {
      return train(prepared, scene, known, progress, log, trained);
    }));
    return report == nullptr ? Outcome() : to_c(trained, scene, report);
  });
}

stgs_result stgs_encoder_check_training(stgs_encoder* encoder,
                                        const stgs_train_settings* settings) {
  using namespace stgs::sdk;
  return guarded(encoder, [&]() -> Outcome {
    stgs_train_settings known = default_train_settings();
    STGS_SDK_TRY(copy_in_settings(settings, known));
    STGS_SDK_TRY(check(known));
    return run_work(*encoder, [&](const auto&, const auto&) {
      return stgs::encoder::check_training(training_of(known), nullptr);
    });
  });
}

}  // extern "C"
