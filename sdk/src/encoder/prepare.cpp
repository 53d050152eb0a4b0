// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/prepare.h"

#include <algorithm>

#include "encoder/encoder.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::sdk {
namespace {

stgs_prepare_settings default_prepare_settings() {
  const encoder::PrepareSettings defaults;
  stgs_prepare_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.layout = STGS_LAYOUT_AUTO;
  settings.first_frame = defaults.first_frame;
  settings.end_frame = defaults.end_frame;
  copy_parameters<encoder::PrepareParameters>(defaults, settings);
  settings.default_test_cameras = 1;
  settings.separate_motion = 1;
  settings.seed = defaults.seed;
  return settings;
}

Outcome check_test_cameras(const stgs_prepare_settings& s) {
  STGS_SDK_TRY(check_flag("default_test_cameras", s.default_test_cameras));
  if (s.test_camera_count == 0) return {};
  if (s.default_test_cameras != 0) {
    return {STGS_ERROR_ARGUMENT,
            "settings: default_test_cameras is 1, but test_camera_count is not 0; set one of them "
            "to 0"};
  }
  if (s.test_cameras == nullptr) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("settings: test_cameras is NULL, but test_camera_count is {}",
                        s.test_camera_count)};
  }
  for (std::uint32_t i = 0; i < s.test_camera_count; ++i) {
    if (s.test_cameras[i] == nullptr) {
      return {STGS_ERROR_ARGUMENT, fmt::format("settings: test_cameras[{}] is NULL", i)};
    }
  }
  return {};
}

Outcome check(const stgs_prepare_settings& s) {
  STGS_SDK_TRY(check_range("layout", s.layout, STGS_LAYOUT_AUTO, STGS_LAYOUT_VIDEOS));
  STGS_SDK_TRY(check_frames(s.first_frame, s.end_frame));
  STGS_SDK_TRY(check_ranges<encoder::PrepareParameters>(s));
  STGS_SDK_TRY(check_test_cameras(s));
  STGS_SDK_TRY(check_backend(s.backend));
  STGS_SDK_TRY(check_flag("separate_motion", s.separate_motion));
  STGS_SDK_TRY(check_flag("overwrite", s.overwrite));
  STGS_SDK_TRY(check_flag("allow_outside", s.allow_outside));
  return check_flag("trust_calibration", s.trust_calibration);
}

#ifdef STGS_HAS_PREPARE

encoder::Layout layout_of(stgs_layout layout) {
  using encoder::Layout;
  constexpr Layout kLayouts[] = {Layout::kAuto,       Layout::kN3dv,   Layout::kPanoptic,
                                 Layout::kEasyVolcap, Layout::kColmap, Layout::kNerfstudio,
                                 Layout::kVideos};
  return kLayouts[layout];
}

Outcome prepare(const char* capture, const char* prepared, const stgs_prepare_settings& s,
                const encoder::ProgressSink& progress, const encoder::LogSink& log) {
  encoder::PrepareSettings settings;
  settings.layout = layout_of(s.layout);
  settings.first_frame = s.first_frame;
  settings.end_frame = s.end_frame;
  copy_parameters<encoder::PrepareParameters>(s, settings);
  settings.default_test_cameras = s.default_test_cameras != 0;
  settings.test_cameras.assign(s.test_cameras, s.test_cameras + s.test_camera_count);
  settings.separate_motion = s.separate_motion != 0;
  settings.seed = s.seed;
  settings.backend = backend_name(s.backend);
  settings.overwrite = s.overwrite != 0;
  settings.allow_outside = s.allow_outside != 0;
  settings.trust_calibration = s.trust_calibration != 0;
  return encoder::prepare(capture, prepared, settings, progress, log);
}

#else

Outcome prepare(const char* capture, const char*, const stgs_prepare_settings&,
                const encoder::ProgressSink&, const encoder::LogSink&) {
  return not_built(
      "{}: this build cannot prepare captures, because it lacks OpenCV or FFmpeg; prepare the "
      "capture with "
      "another build",
      capture);
}

#endif

Outcome to_c(const char* prepared, stgs_prepare_report* to) {
  STGS_ASSIGN(const encoder::PreparedCapture capture, encoder::read_prepared_capture(prepared));
  const auto& cameras = capture.cameras;
  stgs_prepare_report report{};
  report.cameras = static_cast<std::uint32_t>(cameras.size());
  report.test_cameras = static_cast<std::uint32_t>(
      std::count_if(cameras.begin(), cameras.end(), [](const auto& c) { return c.test; }));
  report.frames = static_cast<std::uint32_t>(capture.frames);
  report.frames_per_second = 1.0 / capture.time_base.seconds(1);
  copy_out(to, report);
  return {};
}

}  // namespace
}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_prepare_settings_defaults(stgs_prepare_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, stgs::sdk::default_prepare_settings());
}

stgs_result stgs_encoder_prepare(stgs_encoder* encoder, const char* capture, const char* prepared,
                                 const stgs_prepare_settings* settings,
                                 stgs_prepare_report* report) {
  using namespace stgs::sdk;
  return guarded(encoder, [&]() -> Outcome {
    STGS_SDK_TRY(check_path("capture", capture));
    STGS_SDK_TRY(check_path("prepared", prepared));
    STGS_SDK_TRY(check_report(report));
    stgs_prepare_settings known = default_prepare_settings();
    STGS_SDK_TRY(copy_in_settings(settings, known));
    STGS_SDK_TRY(check(known));
    STGS_SDK_TRY(run_work(*encoder, [&](const auto& progress, const auto& log) {
      return prepare(capture, prepared, known, progress, log);
    }));
    return report == nullptr ? Outcome() : to_c(prepared, report);
  });
}

}  // extern "C"
