// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <optional>

#include "camera_file.h"
#include "command.h"
#include "printable.h"
#include "scene_input.h"
#include "stgs/format/decoder_model.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/scene_statistics.h"
#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

constexpr int kFileSize = 106;  // issue number, spec/conformance.md
// Limit of the rows of a table in text. JSON has all rows.
constexpr std::size_t kMaxRows = 1000;

double bytes_per_primitive(const SceneReader& reader) {
  return reader.primitives() == 0
             ? 0
             : static_cast<double>(reader.file_bytes()) / static_cast<double>(reader.primitives());
}

Json to_json(const DecoderNeeds& needs) {
  return {{"level", needs.level},
          {"primitives", needs.primitives},
          {"bytes", needs.bytes},
          {"decoded_bytes", needs.decoded_bytes},
          {"ranges", needs.ranges},
          {"startup_bytes", needs.startup_bytes},
          {"bits_per_second", needs.bits_per_second},
          {"primitives_per_second", needs.primitives_per_second}};
}

std::string to_text(const DecoderNeeds& needs) {
  return fmt::format(
      "  decoder          {}: peak {} primitives ({} in {}, {} decoded); {} to start, then {:.3g} "
      "Mbit/s and {:.3g} million primitives/s\n",
      needs.level > 0 ? fmt::format("level {}", needs.level) : "above all levels", needs.primitives,
      human_bytes(needs.bytes), plural(needs.ranges, "range"), human_bytes(needs.decoded_bytes),
      human_bytes(needs.startup_bytes), needs.bits_per_second * 1e-6,
      needs.primitives_per_second * 1e-6);
}

const char* form_name(SceneForm form) {
  switch (form) {
    case SceneForm::kGrowing:
      return "growing";
    case SceneForm::kRecorded:
      return "recorded";
    case SceneForm::kFinished:
      break;
  }
  return "finished";
}

Json segments_json(const SceneReader& reader) {
  Json segments = Json::array();
  for (const SegmentInfo& segment : reader.segments()) {
    const TimeBase& base = reader.metadata().time_base;
    segments.push_back({{"level", segment.level},
                        {"begin_s", base.seconds(segment.begin_ticks)},
                        {"end_s", base.seconds(segment.end_ticks)},
                        {"primitives", segment.primitives},
                        {"tier", segment.tier},
                        {"available", segment.available},
                        {"sh_available", segment.sh_available},
                        {"offset", segment.offset},
                        {"bytes", segment.bytes},
                        {"sh_offset", segment.sh_offset},
                        {"sh_bytes", segment.sh_bytes}});
  }
  return segments;
}

// One record of each segment. Layers are ordered by the priority of fetching them.
struct Layer {
  const char* content = "primitives";
  int tier = 0;
  std::uint64_t primitives = 0, bytes = 0;
};

std::vector<Layer> layers_of(const SceneReader& reader) {
  std::vector<Layer> primitives, sh;
  for (const SegmentInfo& segment : reader.segments()) {
    for (int t = static_cast<int>(primitives.size()); t <= segment.tier; ++t) {
      primitives.push_back({"primitives", t, 0, 0});
      sh.push_back({"sh", t, 0, 0});
    }
    Layer& base = primitives[static_cast<std::size_t>(segment.tier)];
    base.primitives += segment.primitives;
    base.bytes += segment.bytes;
    if (segment.sh_bytes == 0) continue;
    Layer& detail = sh[static_cast<std::size_t>(segment.tier)];
    detail.primitives += segment.primitives;
    detail.bytes += segment.sh_bytes;
  }
  std::vector<Layer> layers = primitives;
  for (const Layer& layer : sh) {
    if (layer.bytes > 0) layers.push_back(layer);
  }
  return layers;
}

Json layers_json(const SceneReader& reader) {
  Json layers = Json::array();
  for (const Layer& layer : layers_of(reader)) {
    layers.push_back({{"content", layer.content},
                      {"tier", layer.tier},
                      {"primitives", layer.primitives},
                      {"bytes", layer.bytes}});
  }
  return layers;
}

Json damage_json(const SceneReader& reader) {
  Json damage = Json::array();
  for (const Issue& issue : reader.damage()) {
    damage.push_back(
        {{"number", issue.number}, {"offset", issue.offset}, {"message", issue.message}});
  }
  return damage;
}

Json lost_fragments_json(const SceneReader& reader) {
  const TimeBase& base = reader.metadata().time_base;
  Json fragments = Json::array();
  for (const LostFragment& lost : reader.lost_fragments()) {
    fragments.push_back({{"begin_s", base.seconds(lost.range.begin)},
                         {"end_s", base.seconds(lost.range.end)},
                         {"offset", lost.offset},
                         {"bytes", lost.bytes}});
  }
  return fragments;
}

bool has_up(const SceneMetadata& metadata) {
  return std::any_of(metadata.up, metadata.up + 3, [](float v) { return v != 0.0f; });
}

Json to_json(const SceneReader& reader, const std::string& path) {
  const SceneMetadata& m = reader.metadata();
  Json json = {{"file", path},
               {"version", fmt::format("{}.{}", reader.version_major(), reader.version_minor())},
               {"profile", profile_name(reader.profile())},
               {"form", form_name(reader.form())},
               {"bytes", reader.file_bytes()},
               {"incomplete_bytes", reader.incomplete_bytes()},
               {"unreachable_s", m.time_base.seconds(reader.unreached_frames())},
               {"missing_bytes", reader.missing_bytes()},
               {"complete_s", m.time_base.seconds(reader.complete_ticks())},
               {"damage", damage_json(reader)},
               {"lost_fragments", lost_fragments_json(reader)},
               {"head_bytes", reader.head_bytes()},
               {"primitives", reader.primitives()},
               {"bytes_per_primitive", bytes_per_primitive(reader)},
               {"sh_degree", reader.sh_degree()},
               {"frames", m.frames},
               {"fps", 1.0 / m.time_base.seconds(1)},
               {"duration_s", m.time_base.seconds(m.frames)},
               {"chunk_s", m.time_base.seconds(reader.chunk_ticks())},
               {"time_base", {m.time_base.numerator, m.time_base.denominator}},
               {"bounds",
                {{"min", std::vector<float>(m.bounds_min, m.bounds_min + 3)},
                 {"max", std::vector<float>(m.bounds_max, m.bounds_max + 3)}}},
               {"metres_per_unit", m.metres_per_unit > 0 ? Json(m.metres_per_unit) : Json(nullptr)},
               {"up", nullptr},
               {"floor", nullptr},
               {"audio", nullptr},
               {"background", std::vector<float>(m.background, m.background + 3)},
               {"near_plane", m.near_plane},
               {"generator", m.generator},
               {"title", m.title},
               {"decoder", to_json(decoder_needs(reader))},
               {"start_camera", nullptr},
               {"window", nullptr},
               {"parts", Json::array()},
               {"segments", segments_json(reader)},
               {"layers", layers_json(reader)},
               {"streams", Json::array()}};
  if (m.start_camera) json["start_camera"] = camera_json(*m.start_camera);
  if (has_up(m)) {
    json["up"] = m.up;
    json["floor"] = m.floor;
  }
  if (!m.audio.empty()) {
    json["audio"] = {{"location", m.audio}, {"begin_s", m.time_base.seconds(m.audio_begin)}};
  }
  if (m.window) {
    json["window"] = {{"first_frame", m.window->first_frame},
                      {"capture_frames", m.window->capture_frames}};
  }
  for (const ScenePart& part : reader.parts()) {
    json["parts"].push_back(
        {{"begin_s", m.time_base.seconds(part.begin_ticks)},
         {"end_s", m.time_base.seconds(part.end_ticks)},
         {"shown_begin_s", m.time_base.seconds(std::max(0.0, part.shown_range().begin))},
         {"shown_end_s", m.time_base.seconds(part.shown_range().end)},
         {"primitives", part.primitives}});
  }
  for (const StreamInfo& stream : reader.streams()) {
    json["streams"].push_back(
        {{"name", stream.name}, {"bytes", stream.bytes}, {"raw_bytes", stream.raw_bytes}});
  }
  return json;
}

std::string omitted_rows(std::size_t rows, const char* noun) {
  if (rows <= kMaxRows) return {};
  return fmt::format("  and {} more {}; --format json lists all\n", rows - kMaxRows, noun);
}

std::string to_text(const SceneReader& reader, const std::string& path) {
  const SceneMetadata& m = reader.metadata();
  std::string out = fmt::format(
      "{}\n"
      "  format           {}.{}, {}\n"
      "  size             {} ({} bytes), head with index {}\n"
      "  primitives       {}, {:.1f} bytes each, SH degree {}\n"
      "  duration         {:.3f} s, {} at {:.6g} fps\n"
      "  bounds           {:.4g} {:.4g} {:.4g} to {:.4g} {:.4g} {:.4g}\n",
      path, reader.version_major(), reader.version_minor(), profile_name(reader.profile()),
      human_bytes(reader.file_bytes()), reader.file_bytes(), human_bytes(reader.head_bytes()),
      reader.primitives(), bytes_per_primitive(reader), reader.sh_degree(),
      m.time_base.seconds(m.frames), plural(m.frames, "frame"), 1.0 / m.time_base.seconds(1),
      m.bounds_min[0], m.bounds_min[1], m.bounds_min[2], m.bounds_max[0], m.bounds_max[1],
      m.bounds_max[2]);
  if (m.metres_per_unit > 0) out += fmt::format("  unit             {:.6g} m\n", m.metres_per_unit);
  if (has_up(m)) {
    out += fmt::format("  up               {:.4g} {:.4g} {:.4g}, floor at {:.4g} {:.4g} {:.4g}\n",
                       m.up[0], m.up[1], m.up[2], m.floor[0], m.floor[1], m.floor[2]);
  }
  if (!m.audio.empty()) {
    out += fmt::format("  audio            {}, from {:.3f} s\n", one_line(m.audio),
                       m.time_base.seconds(m.audio_begin));
  }
  if (reader.form() != SceneForm::kFinished) {
    out += fmt::format(
        "  form             live recording, {}; 'stgs finalize' moves its index to the front\n",
        reader.form() == SceneForm::kRecorded ? "closed" : "not closed yet");
  }
  if (reader.incomplete_bytes() > 0) {
    out += fmt::format("  incomplete       {} bytes after its last complete fragment\n",
                       reader.incomplete_bytes());
    if (reader.unreached_frames() > 0) {
      out += fmt::format(
          "  unreachable      these bytes hold frames up to {:.3f} s; a damaged record hides the "
          "fragment that lists them\n",
          m.time_base.seconds(reader.unreached_frames()));
    }
  }
  if (reader.missing_bytes() > 0) {
    std::size_t complete = 0, without_sh = 0;
    for (const SegmentInfo& segment : reader.segments()) {
      complete += segment.available && segment.sh_available ? 1 : 0;
      without_sh += segment.available && !segment.sh_available ? 1 : 0;
    }
    out += fmt::format(
        "  truncated        {} bytes are missing; {} of {} are complete, {} without SH; complete "
        "up to "
        "{:.3f} s\n",
        reader.missing_bytes(), complete, plural(std::ssize(reader.segments()), "segment"),
        without_sh, m.time_base.seconds(reader.complete_ticks()));
  }
  for (const Issue& issue : reader.damage()) {
    if (issue.number == kFileSize && reader.missing_bytes() > 0) continue;  // reported above
    out += fmt::format("  {:<16} byte {}: {}\n", issue.error ? "damaged" : "warning", issue.offset,
                       issue.message);
  }
  for (const LostFragment& lost : reader.lost_fragments()) {
    out += fmt::format("  lost             from {:.3f} s to {:.3f} s, {} bytes\n",
                       m.time_base.seconds(lost.range.begin), m.time_base.seconds(lost.range.end),
                       lost.bytes);
  }
  if (m.start_camera) {
    out += fmt::format("  start camera     {}x{}\n", m.start_camera->width, m.start_camera->height);
  }
  if (m.window) {
    out +=
        fmt::format("  window           frames {}:{} of a capture of {}\n", m.window->first_frame,
                    m.window->first_frame + m.frames, m.window->capture_frames);
  }
  if (reader.parts().size() > 1) {
    for (std::size_t i = 0; i < std::min(reader.parts().size(), kMaxRows); ++i) {
      const ScenePart& part = reader.parts()[i];
      out += fmt::format("  part             {:.3f} s to {:.3f} s, {} primitives\n",
                         m.time_base.seconds(part.shown_range().begin),
                         m.time_base.seconds(part.shown_range().end), part.primitives);
    }
    out += omitted_rows(reader.parts().size(), "parts");
  }
  if (!m.title.empty()) out += fmt::format("  title            {}\n", one_line(m.title));
  if (!m.generator.empty()) {
    out += fmt::format("  written by       {}\n", one_line(m.generator));
  }
  out += fmt::format("  chunk            {:.4g} s (shortest segment)\n",
                     m.time_base.seconds(reader.chunk_ticks()));
  out += to_text(decoder_needs(reader));
  out +=
      "\n  segment  level       tier      from s        to s  primitives       bytes    SH bytes\n";
  for (std::size_t i = 0; i < std::min(reader.segments().size(), kMaxRows); ++i) {
    const SegmentInfo& s = reader.segments()[i];
    out += fmt::format("  {:>7}  {:>10}  {:>4}  {:>10.3f}  {:>10.3f}  {:>10}  {:>10}  {:>10}\n", i,
                       s.level < 0 ? std::string("persistent") : std::to_string(s.level), s.tier,
                       m.time_base.seconds(s.begin_ticks), m.time_base.seconds(s.end_ticks),
                       s.primitives, s.bytes, s.sh_bytes);
  }
  out += omitted_rows(reader.segments().size(), "segments");
  out += "\n  layer                  tier  primitives       bytes   share\n";
  for (const Layer& layer : layers_of(reader)) {
    out += fmt::format(
        "  {:<20}  {:>5}  {:>10}  {:>10}  {:4.1f} %\n", layer.content, layer.tier, layer.primitives,
        layer.bytes,
        100.0 * static_cast<double>(layer.bytes) / static_cast<double>(reader.file_bytes()));
  }
  out += "\n  stream                  bytes   share   of raw\n";
  for (const StreamInfo& s : reader.streams()) {
    const auto share = [](std::uint64_t part, std::uint64_t total) {
      return total == 0 ? 0 : 100.0 * static_cast<double>(part) / static_cast<double>(total);
    };
    out += fmt::format("  {:<16} {:>12}  {:4.1f} %   {:4.1f} %\n", s.name, s.bytes,
                       share(s.bytes, reader.file_bytes()), share(s.bytes, s.raw_bytes));
  }
  return out;
}

// Returns "1234  12.3 %", a share of the visible primitives.
std::string count_and_share(std::uint64_t count, const SceneStatistics& s) {
  const auto visible = static_cast<double>(s.primitives - s.never_visible);
  return fmt::format("{:>10}  {:5.1f} %", count,
                     visible > 0 ? 100.0 * static_cast<double>(count) / visible : 0.0);
}

Json to_json(const std::vector<HistogramBin>& bins) {
  Json json = Json::array();
  for (const HistogramBin& bin : bins) {
    json.push_back({{"from", bin.from},
                    {"to", std::isfinite(bin.to) ? Json(bin.to) : Json(nullptr)},
                    {"primitives", bin.count}});
  }
  return json;
}

Json to_json(const SceneStatistics& s) {
  return {{"never_visible", s.never_visible},
          {"lifespans",
           {{"bins_s", to_json(s.lifespans)},
            {"whole_clip", s.whole_clip},
            {"median_s", s.median_lifespan}}},
          {"speeds", {{"bins", to_json(s.speeds)}, {"median", s.median_speed}}},
          {"static",
           {{"primitives", s.static_primitives},
            {"share", s.static_share()},
            {"bound", s.static_bound},
            {"scene_radius", s.scene_radius},
            {"whole_clip_drift", s.whole_clip_drift}}}};
}

// Lists the bins from the first to the last that is not empty.
std::string to_text(const std::vector<HistogramBin>& bins, const SceneStatistics& s) {
  const auto filled = [](const HistogramBin& bin) { return bin.count > 0; };
  const auto first = std::find_if(bins.begin(), bins.end(), filled);
  const auto last = std::find_if(bins.rbegin(), bins.rend(), filled).base();
  std::string out;
  for (auto bin = first; bin < last; ++bin) {
    const std::string to = std::isfinite(bin->to) ? fmt::format("{:.4g}", bin->to) : "longer";
    out += fmt::format("  {:>10.4g}  {:>10}  {}\n", bin->from, to, count_and_share(bin->count, s));
  }
  return out;
}

std::string to_text(const SceneStatistics& s) {
  return fmt::format(
      "\n  lifespan s  to          primitives (median {:.4g} s, {} never visible)\n{}"
      "  whole clip              {}\n"
      "\n  speed       to          primitives (scene units per second, median {:.4g})\n{}"
      "\n  static                  {}, moving by at most {:.3g} over the clip\n"
      "  drift                   {:.3g} scene units over the clip, mean of those of the whole "
      "clip\n",
      s.median_lifespan, s.never_visible, to_text(s.lifespans, s), count_and_share(s.whole_clip, s),
      s.median_speed, to_text(s.speeds, s), count_and_share(s.static_primitives, s), s.static_bound,
      s.whole_clip_drift);
}

class Info final : public Command {
 public:
  Help help() const override {
    return {
        "info", "Show the contents of a .stgs file",
        "Reads only the header, the metadata and the index, so it is fast for any file size.\n"
        "Prints primitives, duration, bounds, start camera, and bytes by segment and attribute.\n"
        "--lifespans reads the entire file and prints the lifespans (the time with O l(t) >=\n"
        "1/255), the speeds, and the static primitives: visible in every frame and moving over\n"
        "the clip at most 0.001 of the radius around the median position that holds 95 % of\n"
        "the primitives. In a file of several parts, the part of a primitive stands for the\n"
        "clip.",
        "  stgs info scene.stgs\n  stgs info scene.stgs --lifespans --format json"};
  }
  Shared shared() const override { return {}; }
  void declare(CLI::App& app) override {
    app.add_option("FILE", path_, "The .stgs file, or its URL")->required();
    app.add_flag("--lifespans", lifespans_,
                 "Print lifespans, speeds and the share of static primitives");
  }
  Status run(Session& session) override {
    STGS_ASSIGN(const auto reader, open_scene(session, path_));
    std::optional<SceneStatistics> motion;
    if (lifespans_) {
      STGS_ASSIGN(const Scene scene, load_scene(session, path_));
      motion = scene_statistics(scene);
    }
    if (!session.json()) {
      return session.emit({}, to_text(*reader, shown_file()) + (motion ? to_text(*motion) : ""));
    }
    Json json = to_json(*reader, shown_file());
    if (motion) json["motion"] = to_json(*motion);
    return session.emit(json, {});
  }

 private:
  std::string shown_file() const { return player::display_location(path_); }

  std::string path_;
  bool lifespans_ = false;
};

}  // namespace

std::unique_ptr<Command> make_info() {
  return std::make_unique<Info>();
}

}  // namespace stgs::tools
