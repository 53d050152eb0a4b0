// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/pack.h"

#include <algorithm>

#include "encoder/encoder.h"
#include "stgs/format/output_path.h"
#include "stgs/format/temporary.h"

namespace stgs::sdk {
namespace {

stgs_pack_settings default_pack_settings() {
  stgs_pack_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.profile = STGS_PROFILE_QUANTISED;
  copy_parameters<encoder::PackParameters>(encoder::PackSettings{}, settings);
  return settings;
}

bool is_zero(const float* v) {
  return v[0] == 0 && v[1] == 0 && v[2] == 0;
}

Outcome check(const stgs_pack_settings& s) {
  STGS_SDK_TRY(
      check_range("profile", s.profile, STGS_PROFILE_QUANTISED, STGS_PROFILE_NEAR_LOSSLESS));
  STGS_SDK_TRY(check_ranges<encoder::PackParameters>(s));
  for (const float x : s.up) STGS_SDK_TRY(check_range(encoder::kUp, x));
  STGS_SDK_TRY(check_flag("has_floor", s.has_floor));
  STGS_SDK_TRY(check_flag("allow_outside", s.allow_outside));
  STGS_SDK_TRY(check_flag("foreground", s.foreground));
  for (const float x : s.floor) STGS_SDK_TRY(check_range(encoder::kFloor, x));
  return {};
}

Profile profile_of(stgs_profile profile) {
  return profile == STGS_PROFILE_DRACO           ? Profile::kDraco
         : profile == STGS_PROFILE_NEAR_LOSSLESS ? Profile::kNearLossless
                                                 : Profile::kQuantised;
}

encoder::PackSettings packing_of(const stgs_pack_settings& s) {
  encoder::PackSettings settings;
  settings.profile = profile_of(s.profile);
  copy_parameters<encoder::PackParameters>(s, settings);
  settings.against = text_of(s.against);
  settings.allow_outside = s.allow_outside != 0;
  settings.foreground = s.foreground != 0;
  if (!is_zero(s.up)) settings.up = {s.up[0], s.up[1], s.up[2]};
  if (s.has_floor != 0) settings.floor = {s.floor[0], s.floor[1], s.floor[2]};
  if (s.audio != nullptr) settings.audio = s.audio;
  return settings;
}

Status pack(const char* scene, const char* output, const stgs_pack_settings& s,
            const encoder::ProgressSink& progress, const encoder::LogSink& log,
            encoder::PackReport& report) {
  STGS_TRY(check_distinct({{"scene", scene}, {"output", output}}));
  OutputLock lock;
  STGS_TRY(prepare_output(output, lock, log));
  return encoder::pack(scene, output, packing_of(s), &report, progress, log);
}

void to_c(const encoder::PackReport& from, stgs_pack_report* to) {
  stgs_pack_report report{};
  const auto psnr = [](const std::optional<encoder::HeldOutScore>& score) {
    return score ? score->psnr : 0.0;
  };
  report.primitives = from.primitives;
  report.dropped = from.dropped;
  report.damaged_segments = from.damaged_segments;
  report.damaged_sh_segments = from.damaged_sh_segments;
  report.bytes_in = from.bytes_in;
  report.bytes_out = from.bytes_out;
  report.quality = from.quality;
  report.kbps = from.kbps;
  report.position_max = from.position_max;
  report.position_rms = from.position_rms;
  report.colour_rms = from.colour_rms;
  report.opacity_max = from.opacity_max;
  report.visibility_max = from.visibility_max;
  report.time_max = from.time_max;
  report.radius_max = from.radius_max;
  report.sigma_max = from.sigma_max;
  report.images_psnr = from.images_psnr.value_or(0.0);
  report.held_out_before = psnr(from.held_out_before);
  report.held_out_after = psnr(from.held_out_after);
  copy_out(to, report);
}

}  // namespace
}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_pack_settings_defaults(stgs_pack_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, stgs::sdk::default_pack_settings());
}

stgs_result stgs_encoder_pack(stgs_encoder* encoder, const char* scene, const char* output,
                              const stgs_pack_settings* settings, stgs_pack_report* report) {
  using namespace stgs::sdk;
  return guarded(encoder, [&]() -> Outcome {
    STGS_SDK_TRY(check_path("scene", scene));
    STGS_SDK_TRY(check_path("output", output));
    STGS_SDK_TRY(check_report(report));
    stgs_pack_settings known = default_pack_settings();
    STGS_SDK_TRY(copy_in_settings(settings, known));
    STGS_SDK_TRY(check(known));
    stgs::encoder::PackReport packed;
    STGS_SDK_TRY(run_work(*encoder, [&](const auto& progress, const auto& log) {
      return pack(scene, output, known, progress, log, packed);
    }));
    if (report != nullptr) to_c(packed, report);
    return {};
  });
}

}  // extern "C"
