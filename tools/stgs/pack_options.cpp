// SPDX-License-Identifier: Apache-2.0
#include "encode_options.h"

#include <array>

#include "options.h"
#include "usage.h"

namespace stgs::tools {

void PackOptions::declare(Arguments& app) {
  const char* group = "Packing";
  with_choices(
      app.add_option("--profile", profile_,
                     "quantised, or draco: positions coded as Draco point clouds, for comparison;\n"
                     "decoding then needs libdraco"),
      {profile_name(Profile::kQuantised), profile_name(Profile::kDraco)})
      ->capture_default_str()
      ->group(group);
  auto* quality = app.add_option("--quality", quality_,
                                 "0 (smallest file) to 100 (closest to the trained scene)")
                      ->check(number_between(0, 100))
                      ->capture_default_str()
                      ->group(group);
  app.add_option("--target-kbps", target_kbps_,
                 "Instead of --quality: the best quality within this mean bit rate, kbit/s")
      ->check(number_between(0.001, 1e9))
      ->excludes(quality)
      ->group(group);
  app.add_option("--max-error", max_error_,
                 "Largest position error of a primitive at any time, in 1/1000 of a scene unit\n"
                 "(mm if the unit is a metre)")
      ->check(number_between(1e-6, 1e9))
      ->group(group);
  app.add_option("--chunk", chunk_seconds_,
                 "Shortest segment of the timeline, seconds (default: chosen from the lifespans)")
      ->check(number_between(0.01, 3600))
      ->group(group);
  app.add_option(
         "--tiers", tiers_,
         "Number of tiers: the primitives by importance, so that a player can start with the "
         "first tier (default: 3 of similar size; more, of increasing size, if many primitives "
         "are active at once)")
      ->check(number_between(1, 16))
      ->group(group);
  app.add_option("--metres-per-unit", metres_per_unit_, "Metadata: metres per scene unit")
      ->check(number_between(1e-9, 1e9))
      ->group(group);
  const auto vector = [&](const char* name, std::vector<float>& to, const char* about) {
    app.add_option(name, to, about)
        ->delimiter(',')
        ->expected(3)
        ->check(number_between(-1e9, 1e9))
        ->group(group);
  };
  vector("--up", up_, "Metadata: up direction (against gravity) as X,Y,Z");
  vector("--floor", floor_, "Metadata: a point on the floor as X,Y,Z in scene units; with --up");
  auto* audio = app.add_option("--audio", audio_,
                               "Metadata: location of the audio, as a URI or as a path relative to "
                               "the .stgs file")
                    ->group(group);
  app.add_option("--audio-offset", audio_seconds_,
                 "Metadata: time in the clip at which the audio starts, seconds")
      ->check(number_between(-1e6, 1e6))
      ->needs(audio)
      ->group(group);
}

encoder::PackSettings PackOptions::settings() const {
  encoder::PackSettings settings;
  if (profile_ == profile_name(Profile::kDraco)) settings.profile = Profile::kDraco;
  settings.quality = quality_;
  settings.target_kbps = target_kbps_;
  settings.max_error = max_error_;
  settings.tiers = tiers_;
  settings.chunk_seconds = chunk_seconds_;
  const auto point = [](const std::vector<float>& v) {
    return v.size() == 3 ? std::optional(std::array{v[0], v[1], v[2]}) : std::nullopt;
  };
  if (metres_per_unit_ > 0) settings.metres_per_unit = static_cast<float>(metres_per_unit_);
  settings.up = point(up_);
  settings.floor = point(floor_);
  if (!audio_.empty()) settings.audio = audio_;
  settings.audio_begin = audio_seconds_;
  return settings;
}

namespace {

Json held_out_json(const std::optional<encoder::HeldOutScore>& score) {
  if (!score) return nullptr;
  return {{"psnr", score->psnr}, {"psnr_cc", score->psnr_cc}, {"images", score->images}};
}

}  // namespace

Json to_json(const encoder::PackReport& report) {
  Json parts = Json::array();
  for (const encoder::PackedPart& part : report.parts) {
    parts.push_back({{"input", part.input},
                     {"begin_frame", part.begin_ticks},
                     {"end_frame", part.end_ticks},
                     {"primitives", part.primitives}});
  }
  return {{"input_profile", profile_name(report.input_profile)},
          {"primitives", report.primitives},
          {"dropped", report.dropped},
          {"parts", parts},
          {"bytes_in", report.bytes_in},
          {"bytes_out", report.bytes_out},
          {"damaged", {{"segments", report.damaged_segments}, {"sh", report.damaged_sh_segments}}},
          {"bytes_per_primitive", report.bytes_per_primitive},
          {"quality", report.quality},
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
  std::string out = fmt::format("quality {:g}, {:.0f} kbit/s; ", report.quality, report.kbps);
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
