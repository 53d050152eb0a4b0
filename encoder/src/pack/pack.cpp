// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/pack.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "pack/metadata.h"
#include "pack/rate.h"
#include "pack/render_psnr.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/damage_report.h"
#include "stgs/format/differences.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/output_file.h"

namespace stgs::encoder {
namespace {

// Measures the errors of colours, opacities and lifespans of `packed`, whose primitive i was
// primitive order[i] of `original`.
void measure_errors(const Gaussians4D& original, const Scene& packed,
                    const std::vector<std::uint32_t>& order, PackReport& report) {
  const Gaussians4D& decoded = packed.gaussians;
  for_each_in_part(packed, [&](std::size_t i, const TickRange& part) {
    const LifespanError error = lifespan_error(original, order[i], decoded, i, part);
    report.visibility_max = std::max(report.visibility_max, error.visibility);
    report.time_max = std::max(report.time_max, error.time);
    report.radius_max = std::max(report.radius_max, error.radius);
    report.sigma_max = std::max(report.sigma_max, error.sigma);
  });
  const auto sh_stride = static_cast<std::size_t>(3 * original.sh_coefficients());
  double colour_sum = 0.0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::size_t j = order[i];
    for (std::size_t c = 0; c < 3; ++c) {
      const double dc = double{math::kSh00} *
                        (decoded.sh[i * sh_stride + c] - double{original.sh[j * sh_stride + c]});
      colour_sum += dc * dc;
    }
    const double opacity_error = std::abs(double{math::opacity_of(decoded.opacity_logit[i])} -
                                          math::opacity_of(original.opacity_logit[j]));
    report.opacity_max = std::max(report.opacity_max, opacity_error);
  }
  const double n = std::max<double>(1.0, static_cast<double>(order.size()));
  report.colour_rms = std::sqrt(colour_sum / (3.0 * n));
}

// Reads a scene. Reports its bytes and damage.
Result<Scene> read_input(const std::string& path, const ReadLimits& limits, const LogSink& log,
                         PackReport& report) {
  const auto warn = [&](const std::string& text) {
    if (log) log(1, fmt::format("{}: {}", path, text));
  };
  STGS_ASSIGN(const std::unique_ptr<SceneReader> input, SceneReader::open(path, limits));
  report.bytes_in = input->file_bytes();
  report.input_profile = input->profile();
  if (input->profile() != Profile::kLossless) {
    warn(
        "already packed, so packing it again adds further loss; pack the lossless scene that 'stgs "
        "train' wrote, if it is available");
  }
  DamageReport damage;
  STGS_ASSIGN(Scene scene, recover_scene(path, damage, limits));
  for (const std::string& line : describe_damage(damage, scene.metadata.time_base)) warn(line);
  STGS_ASSIGN(const std::vector<std::string> extras, scene_extras(path, limits));
  for (const std::string& extra : extras) warn("not copied to the output: " + extra);
  report.damaged_segments = damage.segments;
  report.damaged_sh_segments = damage.segments_without_sh;
  return scene;
}

// Checks that no setting is without effect in the near-lossless profile.
Status check_near_lossless(const PackSettings& settings) {
  if (settings.profile != Profile::kNearLossless) return {};
  const bool sized = settings.target_kbps > 0 || settings.target_size > 0;
  if (settings.quality == 0 && !sized && settings.target_psnr == 0) return {};
  return usage_error(
      "the profile {} takes neither --quality nor a target; use it alone or with --max-error, or "
      "use the profile {}",
      profile_name(Profile::kNearLossless), profile_name(Profile::kQuantised));
}

Status check_numbers(const PackSettings& settings) {
  STGS_TRY(check_profile(settings.profile));
  STGS_TRY(check_parameters<PackParameters>(settings));
  STGS_TRY(check_limits(settings));
  return check_near_lossless(settings);
}

}  // namespace

Status apply_metadata(const PackSettings& settings, SceneMetadata& metadata) {
  if (settings.audio) {
    metadata.audio = *settings.audio;
    metadata.audio_begin = metadata.time_base.ticks(settings.audio_begin);
  }
  if (settings.metres_per_unit > 0) {
    metadata.metres_per_unit = static_cast<float>(settings.metres_per_unit);
  }
  if (settings.up) {
    const auto [x, y, z] = *settings.up;
    const double length = std::hypot(double{x}, double{y}, double{z});
    if (!(length > 0))
      return usage_error("--up: the vector {},{},{} has no direction (expected any length but 0)",
                         x, y, z);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      metadata.up[axis] = static_cast<float>((*settings.up)[axis] / length);
    }
  }
  if (!settings.floor) return {};
  const float* up = metadata.up;
  if (up[0] == 0.0f && up[1] == 0.0f && up[2] == 0.0f) {
    return usage_error("--floor requires an up vector; set one with --up");
  }
  std::copy(settings.floor->begin(), settings.floor->end(), metadata.floor);
  return {};
}

Status check_packing(const PackSettings& settings) {
  STGS_TRY(check_numbers(settings));
  if (settings.foreground && settings.against.empty() && !settings.against_capture) {
    return usage_error("foreground has no effect without against, a prepared capture");
  }
  SceneMetadata metadata;
  return apply_metadata(settings, metadata);
}

namespace {

// Loads the test images of the capture that the scene was trained on.
Result<HeldOutViews> load_held_out_views(const Scene& scene, const std::string& name,
                                         const PackSettings& settings, const LogSink& log) {
  const std::string& folder = settings.against;
  if (scene.parts.size() > 1) {
    return usage_error(
        "{}: the loss against a capture cannot be measured for a scene of {} parts; run 'stgs "
        "evaluate' on the packed scene",
        name, scene.parts.size());
  }
  PreparedCapture complete;
  if (settings.against_capture) {
    complete = *settings.against_capture;
  } else {
    STGS_ASSIGN(complete, read_prepared_capture(folder, settings.allow_outside));
  }
  if (settings.foreground) complete.mask_background = kMaskBackground;
  STGS_ASSIGN(const PreparedCapture capture, capture_for_scene(complete, scene.metadata, name));
  STGS_TRY(check_same_times(capture, scene.metadata, name));
  warn_if_other_capture(capture, scene.metadata, name, log);
  STGS_ASSIGN(HeldOutViews views, HeldOutViews::load(capture));
  if (views.empty())
    return usage_error("{}: no test cameras; prepare the capture with test cameras", folder);
  return views;
}

// Measures the scores of renders. Failure is only a warning, because the file does not depend on
// them.
void measure_psnr(const Scene& scene, const Scene& packed, const HeldOutViews* views,
                  const std::optional<HeldOutScore>& before, const LogSink& log,
                  PackReport& report) {
  try {
    report.images_psnr = render_psnr(scene, packed);
    if (views == nullptr) return;
    const float* b = scene.metadata.background;
    const math::Vec3 background{b[0], b[1], b[2]};
    report.held_out_before =
        before ? before : views->evaluate(scene.gaussians, background, scene.metadata.kernel);
    report.held_out_after = views->evaluate(packed.gaussians, background, scene.metadata.kernel);
  } catch (const std::length_error& error) {
    if (log)
      log(1, fmt::format("the PSNR of the packed scene could not be measured: {}", error.what()));
  }
}

}  // namespace

Status pack(const std::string& scene_path, const std::string& output_path,
            const PackSettings& settings, PackReport* report, const ProgressSink& progress,
            const LogSink& log) {
  const auto report_progress = [&](double done, const char* detail) -> Status {
    if (!progress || progress({"pack", done, -1, detail})) return {};
    return runtime_error("{}: packing stopped; nothing was written", output_path);
  };
  STGS_TRY(check_numbers(settings));
  STGS_TRY(report_progress(0, "reading"));
  PackReport found;
  STGS_ASSIGN(Scene scene, read_input(scene_path, settings.limits, log, found));
  STGS_TRY(apply_metadata(settings, scene.metadata));
  std::optional<HeldOutViews> views;
  if (!settings.against.empty() || settings.against_capture) {
    STGS_ASSIGN(views, load_held_out_views(scene, scene_path, settings, log));
  }
  STGS_TRY(report_progress(0.1, "compressing"));
  double done = 0.1;  // the number of attempts is unknown: each takes a fraction of the remainder
  const auto next_attempt = [&] {
    return report_progress(done += 0.15 * (0.8 - done), "compressing");
  };
  const Result<Packed> result = pack_within(scene, settings, next_attempt);
  if (result.status().code() == StatusCode::kInvalidFile) {
    return invalid_file("{}: {}", scene_path, result.status().message());
  }
  STGS_TRY(result.status());
  const Packed& packed = *result;
  STGS_TRY(report_progress(0.8, "measuring"));
  measure_psnr(scene, packed.decoded, views ? &*views : nullptr, settings.held_out_before, log,
               found);
  STGS_TRY(report_progress(0.95, "writing"));
  STGS_TRY(write_file_atomically(output_path, packed.bytes));
  // Too late to cancel.
  if (progress) progress({"pack", 1, -1, "written"});
  if (report == nullptr) return {};
  *report = std::move(found);
  const auto primitives = static_cast<double>(packed.order.size());
  report->primitives = packed.order.size();
  report->dropped = scene.gaussians.size() - packed.left_out - packed.order.size();
  report->bytes_out = packed.bytes.size();
  report->bytes_per_primitive =
      static_cast<double>(packed.bytes.size()) / std::max(1.0, primitives);
  report->quality = packed.quality;
  report->left_out = packed.left_out;
  report->kbps = kbps_of(packed.bytes.size(), scene.metadata);
  report->position_max = packed.position_max;
  report->position_rms = packed.position_rms;
  measure_errors(scene.gaussians, packed.decoded, packed.order, *report);
  return {};
}

}  // namespace stgs::encoder
