// SPDX-License-Identifier: Apache-2.0
#include "import_options.h"

#include "error_report.h"
#include "options.h"

namespace stgs::tools {
namespace {

Json to_json(const SequenceTolerances& t) {
  return {{"position", t.position},
          {"log_scale", t.log_scale},
          {"rotation", t.rotation},
          {"opacity", t.opacity},
          {"colour", t.colour}};
}

Json to_json(const SequenceReport& r) {
  return {{"frames", r.frames},          {"splats", r.splats},
          {"primitives", r.primitives},  {"whole_clip", r.whole_clip},
          {"moving", r.moving},          {"matched", r.matched()},
          {"errors", to_json(r.errors)}, {"position_error", r.position_error}};
}

Json to_json(const SplatvReport& r) {
  return {{"bent", r.bent},
          {"path_max", r.path_max},
          {"path_rms", r.path_rms},
          {"rotation_max", r.rotation_max}};
}

Json to_json(const CurveReport& r) {
  return {{"curved", r.curved},
          {"divided", r.divided},
          {"pieces", r.pieces},
          {"above_bound", r.above_bound},
          {"position_max", r.position_max},
          {"position_relative_max", r.position_relative_max},
          {"opacity_max", r.opacity_max}};
}

}  // namespace

void ImportOptions::declare(Arguments& app) {
  const char* group = "Animated formats";
  app.add_option(
         "--fps", fps_,
         "Frame rate of a folder of PLY frames, a .splatv, a .4dgs, a .ftgs.ply, or a .tsog\n"
         "that does not state it (default: 30, or for a .4dgs the rate that it states)")
      ->check(number_between(0.001, 1000))
      ->group(group);
  app.add_option("--frames", frames_,
                 "Number of frames of a .splatv, which does not store it (default: 50), or of a\n"
                 ".ftgs.ply or .tsog that does not state it (default: 300)")
      ->check(number_between(1, 1'000'000))
      ->group(group);
  app.add_option(
         "--tolerance", tolerance_,
         "For a folder of PLY frames and a .4dgs with keyframes: how much a splat may change\n"
         "between frames and remain one primitive, in multiples of 0.02 of its size and 1/255\n"
         "of colour and opacity. For a .sogst: how far a line may be from a curved path, in\n"
         "multiples of 0.1 of the splat's size and 0.02 of opacity (default: 1)")
      ->check(number_between(0, 1000))
      ->group(group);
}

Status ImportOptions::check(const std::string& path, const InterchangeFormat* format) const {
  using Kind = InterchangeFormat::SettingsKind;
  const Kind kind = format == nullptr ? Kind::kNone : format->settings_kind;
  const char* name = format == nullptr ? "STGS" : format->name;
  if (fps_ && kind != Kind::kSequence && kind != Kind::kSplatv && kind != Kind::kFourdgs &&
      kind != Kind::kClip) {
    return usage_error(
        "{}: --fps applies to a folder of PLY frames, .splatv, .4dgs, .tsog and .ftgs.ply, not to "
        "{}",
        path, name);
  }
  if (frames_ && kind != Kind::kSplatv && kind != Kind::kClip) {
    return usage_error("{}: --frames applies to .splatv, .tsog and .ftgs.ply, not to {}", path,
                       name);
  }
  if (tolerance_ && kind != Kind::kSequence && kind != Kind::kFourdgs && kind != Kind::kCurves) {
    return usage_error(
        "{}: --tolerance applies to a folder of PLY frames, .4dgs and .sogst, not to {}", path,
        name);
  }
  return {};
}

ImportSettings ImportOptions::settings() const {
  ImportSettings settings;
  if (fps_) {
    settings.sequence.frame_time = settings.splatv.frame_time = frame_time_of(*fps_);
    settings.fourdgs.frame_time = settings.sequence.frame_time;
    settings.clip.frame_time = frame_time_of(*fps_);
  }
  if (frames_) settings.splatv.frames = *frames_;
  settings.clip.frames = frames_;
  const double factor = tolerance_.value_or(1);
  SequenceTolerances& t = settings.sequence.tolerances;
  for (double* value : {&t.position, &t.log_scale, &t.rotation, &t.opacity, &t.colour}) {
    *value *= factor;
  }
  if (tolerance_) settings.fourdgs.tolerances = t;
  settings.curves.position *= factor;
  settings.curves.opacity *= factor;
  return settings;
}

Json import_json(const ImportReport& report) {
  return {{"sequence", report.sequence ? to_json(*report.sequence) : Json(nullptr)},
          {"splatv", report.splatv ? to_json(*report.splatv) : Json(nullptr)},
          {"curves", report.curves ? to_json(*report.curves) : Json(nullptr)}};
}

Status with_readable_formats(const Status& status) {
  constexpr std::uint64_t kTooShort = 101, kNoMagic = 102;  // spec/conformance.md, 2
  if (!has_issue(status, kTooShort) && !has_issue(status, kNoMagic)) return status;
  std::string text = "convert reads STGS";
  for (const InterchangeFormat& format : interchange_formats()) {
    // One that is read without an extension is STGS of version 1.
    if (format.read_path != nullptr || (format.read != nullptr && *format.extension != '\0'))
      text += fmt::format(", {}", format.name);
  }
  return with_advice(status, text);
}

std::string import_text(const ImportReport& report) {
  if (!report.sequence) return {};
  const SequenceReport& r = *report.sequence;
  return fmt::format(
      "{}, {} merged into {} primitives ({} visible at every frame, {} moving); {:.1f} % of the "
      "splats after the first frame continue a primitive\n"
      "largest errors: position {:.3g} scene units ({:.3g} of the splat's size), log scale {:.3g}, "
      "opacity {:.3g}, colour {:.3g}\n",
      plural(r.frames, "frame"), plural(r.splats, "splat"), r.primitives, r.whole_clip, r.moving,
      100 * r.matched(), r.position_error, r.errors.position, r.errors.log_scale, r.errors.opacity,
      r.errors.colour);
}

}  // namespace stgs::tools
