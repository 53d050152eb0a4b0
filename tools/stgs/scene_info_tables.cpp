// SPDX-License-Identifier: Apache-2.0
// The tables of `stgs info --segments` and `--lifespans`.
#include <algorithm>
#include <cmath>
#include <span>
#include <string_view>
#include <utility>

#include "scene_info.h"

namespace stgs::tools {
namespace {

// Limit of the rows of a table in text. JSON has all rows.
constexpr std::size_t kMaxRows = 1000;

std::string omitted_rows(std::size_t rows, const char* noun) {
  if (rows <= kMaxRows) return {};
  return fmt::format("  and {} more {}; --format json lists all\n", rows - kMaxRows, noun);
}

std::string segment_table(const SceneInfo& info) {
  std::string out =
      "\n   number  level       tier      from s        to s  primitives       bytes    SH bytes\n";
  for (std::size_t i = 0; i < std::min(info.segments.size(), kMaxRows); ++i) {
    const stgs_segment& s = info.segments[i];
    out += fmt::format("  {:>7}  {:>10}  {:>4}  {:>10.3f}  {:>10.3f}  {:>10}  {:>10}  {:>10}\n", i,
                       s.level < 0 ? std::string("persistent") : std::to_string(s.level), s.tier,
                       s.begin_seconds, s.end_seconds, s.primitives, s.bytes, s.sh_bytes);
  }
  return out + omitted_rows(info.segments.size(), "tiers of segments");
}

double percent(std::uint64_t part, std::uint64_t total) {
  return total == 0 ? 0 : 100.0 * static_cast<double>(part) / static_cast<double>(total);
}

std::string layer_table(const SceneInfo& info) {
  std::string out = "\n  layer                  tier  primitives       bytes   share\n";
  for (const SceneLayer& layer : info.layers()) {
    out += fmt::format("  {:<20}  {:>5}  {:>10}  {:>10}  {:4.1f} %\n", layer.content, layer.tier,
                       layer.primitives, layer.bytes, percent(layer.bytes, info.scene.file_bytes));
  }
  return out;
}

// Returns the unit of an attribute's errors (spec 4.7), with a space before it; SH have none.
std::string_view error_unit(std::string_view stream) {
  constexpr std::pair<std::string_view, std::string_view> kUnits[] = {
      {"position", " units"},   {"velocity", " units per frame"},
      {"time", " frames"},      {"sigma", " frames"},
      {"radius", " frames"},    {"log_scale", " (natural logarithm)"},
      {"rotation", " radians"}, {"opacity", " (logit)"}};
  for (const auto& [name, unit] : kUnits) {
    if (name == stream) return unit;
  }
  return {};
}

std::string stream_table(const SceneInfo& info) {
  std::string out = "\n  stream                  bytes   share   of raw\n";
  for (const stgs_stream& s : info.streams) {
    out += info.has_stream_bytes()
               ? fmt::format("  {:<16} {:>12}  {:4.1f} %   {:4.1f} %", s.name, s.bytes,
                             percent(s.bytes, info.scene.file_bytes), percent(s.bytes, s.raw_bytes))
               : fmt::format("  {:<16} {:>12}  {:>6}   {:>6}", s.name, "not stated", "-", "-");
    if (s.max_error >= 0) {
      out += fmt::format("   errors up to {:.3g}, rms {:.3g}{}", s.max_error, s.rms_error,
                         error_unit(s.name));
    }
    out += "\n";
  }
  return out;
}

// Returns "1234  12.3 %", a share of the visible primitives.
std::string count_and_share(std::uint64_t count, const stgs_scene_statistics& s) {
  return fmt::format("{:>10}  {:5.1f} %", count, percent(count, s.primitives - s.never_visible));
}

// Lists the bins from the first to the last that is not empty.
std::string bin_rows(std::span<const stgs_histogram_bin> bins, const stgs_scene_statistics& s) {
  const auto filled = [](const stgs_histogram_bin& bin) { return bin.primitives > 0; };
  const auto first = std::find_if(bins.begin(), bins.end(), filled);
  const auto last = std::find_if(bins.rbegin(), bins.rend(), filled).base();
  std::string out;
  for (auto bin = first; bin < last; ++bin) {
    const std::string to = std::isfinite(bin->to) ? fmt::format("{:.4g}", bin->to) : "longer";
    out += fmt::format("  {:>10.4g}  {:>10}  {}\n", bin->from, to,
                       count_and_share(bin->primitives, s));
  }
  return out;
}

}  // namespace

std::string part_rows(const SceneInfo& info) {
  std::string out;
  for (std::size_t i = 0; i < std::min(info.parts.size(), kMaxRows); ++i) {
    const stgs_part& part = info.parts[i];
    out += fmt::format("  part             {:.3f} s to {:.3f} s, {}\n", part.shown_begin_seconds,
                       part.shown_end_seconds, plural(part.primitives, "primitive"));
  }
  return out + omitted_rows(info.parts.size(), "parts");
}

std::string tables_text(const SceneInfo& info) {
  const stgs_decoder_needs& needs = info.decoder;
  std::string out = fmt::format(
      "  chunk            {:.4g} s (shortest segment)\n"
      "  decoder          {}: peak {} ({} in {}, {} decoded); {} to start, then {:.3g} Mbit/s and "
      "{:.3g} million primitives/s\n",
      info.contents.chunk_seconds, level_text(needs), plural(needs.primitives, "primitive"),
      human_bytes(needs.bytes), plural(needs.ranges, "range"), human_bytes(needs.decoded_bytes),
      human_bytes(needs.startup_bytes), needs.bits_per_second * 1e-6,
      needs.primitives_per_second * 1e-6);
  if (info.parts.size() > 1 && !lists_parts(info)) out += part_rows(info);
  return out + segment_table(info) + layer_table(info) + stream_table(info);
}

std::string statistics_text(const stgs_scene_statistics& s) {
  return fmt::format(
      "\n  lifespan s  to          primitives (median {:.4g} s, {} never visible)\n{}"
      "  whole clip              {}\n"
      "\n  speed       to          primitives (scene units per second, median {:.4g})\n{}"
      "\n  static                  {}, moving by at most {:.3g} over the clip\n"
      "  drift                   {:.3g} scene units over the clip, mean of those of the whole "
      "clip\n",
      s.median_lifespan, s.never_visible, bin_rows({s.lifespans, s.lifespan_bins}, s),
      count_and_share(s.whole_clip, s), s.median_speed, bin_rows({s.speeds, s.speed_bins}, s),
      count_and_share(s.static_primitives, s), s.static_bound, s.whole_clip_drift);
}

}  // namespace stgs::tools
