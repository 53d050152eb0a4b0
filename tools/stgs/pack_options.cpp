// SPDX-License-Identifier: Apache-2.0
#include "encode_options.h"

#include <CLI/CLI.hpp>

#include "options.h"

namespace stgs::tools {

void PackOptions::declare(CLI::App& app) {
  const char* group = "Packing";
  app.add_option("--quality", quality_, "0 (smallest) to 100 (nearest to what was trained)")
      ->check(number_between(0, 100))
      ->capture_default_str()
      ->group(group);
  app.add_option("--chunk", chunk_seconds_,
                 "Shortest segment of the timeline, seconds; chosen for the scene's lifespans "
                 "where it is not given")
      ->check(number_between(0.01, 3600))
      ->group(group);
  app.add_option("--tiers", tiers_,
                 "Parts of a segment by importance: a player may begin with the first alone")
      ->check(number_between(1, 16))
      ->capture_default_str()
      ->group(group);
}

encoder::PackSettings PackOptions::settings() const {
  encoder::PackSettings settings;
  settings.quality = quality_;
  settings.tiers = tiers_;
  settings.chunk_seconds = chunk_seconds_;
  return settings;
}

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
          {"bytes_per_primitive", report.bytes_per_primitive},
          {"errors",
           {{"position_max", report.position_max},
            {"position_rms", report.position_rms},
            {"colour_rms", report.colour_rms},
            {"opacity_max", report.opacity_max}}}};
}

}  // namespace stgs::tools
