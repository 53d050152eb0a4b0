// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "camera_file.h"
#include "scene_info.h"
#include "stgs/format/decoder_model.h"

namespace stgs::tools {
namespace {

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

Json layers_json(const SceneReader& reader) {
  Json layers = Json::array();
  for (const SceneLayer& layer : layers_of(reader)) {
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

Json to_json(const std::vector<HistogramBin>& bins) {
  Json json = Json::array();
  for (const HistogramBin& bin : bins) {
    json.push_back({{"from", bin.from},
                    {"to", std::isfinite(bin.to) ? Json(bin.to) : Json(nullptr)},
                    {"primitives", bin.count}});
  }
  return json;
}

}  // namespace

std::vector<SceneLayer> layers_of(const SceneReader& reader) {
  std::vector<SceneLayer> primitives, sh;
  for (const SegmentInfo& segment : reader.segments()) {
    for (int t = static_cast<int>(primitives.size()); t <= segment.tier; ++t) {
      primitives.push_back({"primitives", t, 0, 0});
      sh.push_back({"sh", t, 0, 0});
    }
    SceneLayer& base = primitives[static_cast<std::size_t>(segment.tier)];
    base.primitives += segment.primitives;
    base.bytes += segment.bytes;
    if (segment.sh_bytes == 0) continue;
    SceneLayer& detail = sh[static_cast<std::size_t>(segment.tier)];
    detail.primitives += segment.primitives;
    detail.bytes += segment.sh_bytes;
  }
  std::vector<SceneLayer> layers = primitives;
  for (const SceneLayer& layer : sh) {
    if (layer.bytes > 0) layers.push_back(layer);
  }
  return layers;
}

std::optional<double> mean_kbps(const SceneReader& reader) {
  const SceneMetadata& m = reader.metadata();
  if (m.frames <= 1) return std::nullopt;
  return 8e-3 * static_cast<double>(reader.file_bytes()) / m.time_base.seconds(m.frames);
}

double bytes_per_primitive(const SceneReader& reader) {
  return reader.primitives() == 0
             ? 0
             : static_cast<double>(reader.file_bytes()) / static_cast<double>(reader.primitives());
}

bool has_up(const SceneMetadata& metadata) {
  return std::any_of(metadata.up, metadata.up + 3, [](float v) { return v != 0.0f; });
}

Json info_json(const SceneReader& reader, const std::string& name) {
  const SceneMetadata& m = reader.metadata();
  const std::optional<double> kbps = mean_kbps(reader);
  Json json = {{"file", name},
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
               {"kbps", kbps ? Json(*kbps) : Json(nullptr)},
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

Json statistics_json(const SceneStatistics& s) {
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

}  // namespace stgs::tools
