// SPDX-License-Identifier: Apache-2.0
#include "encode_options.h"

#include <array>

#include "options.h"
#include "parameter_options.h"
#include "usage.h"

namespace stgs::tools {

void exclude_limits(const std::map<std::string, Argument*>& options) {
  options.at("target_kbps")->excludes(options.at("quality"));
  options.at("target_size")->excludes(options.at("quality"));
  options.at("target_size")->excludes(options.at("target_kbps"));
  for (const char* other : {"quality", "target_kbps", "target_size"})
    options.at("target_psnr")->excludes(options.at(other));
}

void PackOptions::declare(Arguments& app) {
  const char* group = "Packing";
  with_choices(
      app.add_option("--profile", profile_,
                     "quantised, near-lossless: no visible difference, for archives, or draco:\n"
                     "positions coded as Draco point clouds, for comparison; decoding then needs\n"
                     "libdraco"),
      {profile_name(Profile::kQuantised), profile_name(Profile::kNearLossless),
       profile_name(Profile::kDraco)})
      ->capture_default_str()
      ->group(group);
  const auto options = declare_parameters<encoder::PackParameters>(app, settings_, group);
  exclude_limits(options);
  const auto vector = [&](const Parameter& parameter, std::vector<float>& to, const char* more) {
    app.add_option(parameter.option_name(), to, option_help(parameter) + more)
        ->delimiter(',')
        ->expected(3)
        ->check(number_between(parameter.min, parameter.max))
        ->group(group);
  };
  vector(encoder::kUp, up_, ", as X,Y,Z");
  vector(encoder::kFloor, floor_, ", as X,Y,Z; with --up");
  options.at("audio_begin")
      ->needs(app.add_option("--audio", audio_,
                             "Metadata: location of the audio, as a URI or as a path relative to "
                             "the .stgs file")
                  ->group(group));
}

encoder::PackSettings PackOptions::settings() const {
  encoder::PackSettings settings = settings_;
  for (const Profile profile : {Profile::kNearLossless, Profile::kDraco}) {
    if (profile_ == profile_name(profile)) settings.profile = profile;
  }
  const auto point = [](const std::vector<float>& v) {
    return v.size() == 3 ? std::optional(std::array{v[0], v[1], v[2]}) : std::nullopt;
  };
  settings.up = point(up_);
  settings.floor = point(floor_);
  if (!audio_.empty()) settings.audio = audio_;
  return settings;
}

namespace {

Json held_out_json(const std::optional<encoder::HeldOutScore>& score) {
  if (!score) return nullptr;
  return {{"psnr", score->psnr}, {"psnr_cc", score->psnr_cc}, {"images", score->images}};
}

}  // namespace

Json to_json(const encoder::PackReport& report) {
  return {{"input_profile", profile_name(report.input_profile)},
          {"primitives", report.primitives},
          {"dropped", report.dropped},
          {"left_out", report.left_out},
          {"bytes_in", report.bytes_in},
          {"bytes_out", report.bytes_out},
          {"damaged", {{"segments", report.damaged_segments}, {"sh", report.damaged_sh_segments}}},
          {"bytes_per_primitive", report.bytes_per_primitive},
          {"quality", report.quality > 0 ? Json(report.quality) : Json(nullptr)},
          {"kbps", report.kbps},
          {"images_psnr", report.images_psnr ? Json(*report.images_psnr) : Json(nullptr)},
          {"held_out",
           {{"before", held_out_json(report.held_out_before)},
            {"after", held_out_json(report.held_out_after)}}},
          {"errors",
           {{"position_max", report.position_max},
            {"position_rms", report.position_rms},
            {"colour_rms", report.colour_rms},
            {"opacity_max", report.opacity_max},
            {"visibility_max", report.visibility_max},
            {"time_max", report.time_max},
            {"radius_max", report.radius_max},
            {"sigma_max", report.sigma_max}}}};
}

std::string quality_text(const encoder::PackReport& report) {
  std::string out =
      report.quality > 0 ? fmt::format("quality {:g}, ", report.quality) : "near-lossless, ";
  out += fmt::format("{:.0f} kbit/s; ", report.kbps);
  if (report.left_out > 0) {
    out += fmt::format("{} of least importance left out; ", plural(report.left_out, "primitive"));
  }
  out += report.images_psnr
             ? fmt::format("PSNR against the trained scene {:.1f} dB", *report.images_psnr)
             : std::string("PSNR against the trained scene not measured (no start camera)");
  if (report.held_out_before && report.held_out_after) {
    const double before = report.held_out_before->psnr, after = report.held_out_after->psnr;
    out += fmt::format(
        "; held-out cameras {:.2f} dB, before packing {:.2f} dB: packing cost {:.2f} dB", after,
        before, before - after);
  }
  return out + "\n";
}

}  // namespace stgs::tools
