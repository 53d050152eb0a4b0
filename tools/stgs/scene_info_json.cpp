// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "scene_info.h"

namespace stgs::tools {
namespace {

Json to_json(const stgs_decoder_needs& needs) {
  return {{"level", needs.level},
          {"primitives", needs.primitives},
          {"bytes", needs.bytes},
          {"decoded_bytes", needs.decoded_bytes},
          {"ranges", needs.ranges},
          {"startup_bytes", needs.startup_bytes},
          {"bits_per_second", needs.bits_per_second},
          {"primitives_per_second", needs.primitives_per_second}};
}

const char* form_name(stgs_form form) {
  switch (form) {
    case STGS_FORM_GROWING:
      return "growing";
    case STGS_FORM_RECORDED:
      return "recorded";
    default:
      return "finished";
  }
}

Json vector_json(const float* v, int count = 3) {
  return std::vector<float>(v, v + count);
}

Json camera_json(const stgs_view& view) {
  return {{"width", view.width},
          {"height", view.height},
          {"fx", view.fx},
          {"fy", view.fy},
          {"cx", view.cx},
          {"cy", view.cy},
          {"rotation", vector_json(view.rotation, 9)},
          {"translation", vector_json(view.translation)}};
}

Json segments_json(const SceneInfo& info) {
  Json segments = Json::array();
  for (const stgs_segment& segment : info.segments) {
    segments.push_back({{"level", segment.level},
                        {"begin_s", segment.begin_seconds},
                        {"end_s", segment.end_seconds},
                        {"primitives", segment.primitives},
                        {"tier", segment.tier},
                        {"available", segment.available != 0},
                        {"sh_available", segment.sh_available != 0},
                        {"offset", segment.offset},
                        {"bytes", segment.bytes},
                        {"sh_offset", segment.sh_offset},
                        {"sh_bytes", segment.sh_bytes}});
  }
  return segments;
}

Json layers_json(const SceneInfo& info) {
  Json layers = Json::array();
  for (const SceneLayer& layer : info.layers()) {
    layers.push_back({{"content", layer.content},
                      {"tier", layer.tier},
                      {"primitives", layer.primitives},
                      {"bytes", layer.bytes}});
  }
  return layers;
}

Json damage_json(const SceneInfo& info) {
  Json damage = Json::array();
  for (const stgs_issue& issue : info.issues) {
    damage.push_back(
        {{"number", issue.number}, {"offset", issue.offset}, {"message", issue.message}});
  }
  return damage;
}

Json lost_fragments_json(const SceneInfo& info) {
  Json fragments = Json::array();
  for (const stgs_lost_fragment& lost : info.lost_fragments) {
    fragments.push_back({{"begin_s", lost.begin_seconds},
                         {"end_s", lost.end_seconds},
                         {"offset", lost.offset},
                         {"bytes", lost.bytes}});
  }
  return fragments;
}

Json parts_json(const SceneInfo& info) {
  Json parts = Json::array();
  for (const stgs_part& part : info.parts) {
    parts.push_back({{"begin_s", part.begin_seconds},
                     {"end_s", part.end_seconds},
                     {"shown_begin_s", std::max(0.0, part.shown_begin_seconds)},
                     {"shown_end_s", part.shown_end_seconds},
                     {"primitives", part.primitives}});
  }
  return parts;
}

Json streams_json(const SceneInfo& info) {
  Json streams = Json::array();
  for (const stgs_stream& stream : info.streams) {
    const auto error = [](double v) { return v >= 0 ? Json(v) : Json(nullptr); };
    streams.push_back({{"name", stream.name},
                       {"bytes", info.has_stream_bytes() ? Json(stream.bytes) : Json(nullptr)},
                       {"raw_bytes", stream.raw_bytes},
                       {"max_error", error(stream.max_error)},
                       {"rms_error", error(stream.rms_error)}});
  }
  return streams;
}

Json bins_json(const stgs_histogram_bin* bins, std::uint32_t count) {
  Json json = Json::array();
  for (std::uint32_t i = 0; i < count; ++i) {
    json.push_back({{"from", bins[i].from},
                    {"to", std::isfinite(bins[i].to) ? Json(bins[i].to) : Json(nullptr)},
                    {"primitives", bins[i].primitives}});
  }
  return json;
}

}  // namespace

Json info_json(const SceneInfo& info) {
  const stgs_scene_info& m = info.scene;
  const std::optional<double> kbps = info.mean_kbps();
  Json json = {{"file", info.name},
               {"version", fmt::format("{}.{}", m.format_major, m.format_minor)},
               {"profile", info.profile},
               {"form", form_name(info.contents.form)},
               {"bytes", m.file_bytes},
               {"incomplete_bytes", info.contents.incomplete_bytes},
               {"missing_bytes", info.contents.missing_bytes},
               {"complete_s", m.complete_seconds},
               {"damage", damage_json(info)},
               {"lost_fragments", lost_fragments_json(info)},
               {"head_bytes", info.contents.head_bytes},
               {"primitives", m.primitives},
               {"bytes_per_primitive", info.bytes_per_primitive()},
               {"sh_degree", m.sh_degree},
               {"frames", m.frames},
               {"fps", 1.0 / info.frame_seconds()},
               {"duration_s", m.duration_seconds},
               {"kbps", kbps ? Json(*kbps) : Json(nullptr)},
               {"chunk_s", info.contents.chunk_seconds},
               {"time_base", {m.time_base_numerator, m.time_base_denominator}},
               {"bounds", {{"min", vector_json(m.bounds_min)}, {"max", vector_json(m.bounds_max)}}},
               {"metres_per_unit", m.metres_per_unit > 0 ? Json(m.metres_per_unit) : Json(nullptr)},
               {"up", nullptr},
               {"floor", nullptr},
               {"audio", nullptr},
               {"background", vector_json(m.background)},
               {"colour", {{"primaries", m.colour_primaries}, {"transfer", m.transfer_function}}},
               {"kernel", m.kernel == 0 ? "dilated" : "band-limited"},
               {"near_plane", m.near_plane},
               {"generator", info.generator},
               {"title", info.title},
               {"decoder", to_json(info.decoder)},
               {"start_camera", nullptr},
               {"window", nullptr},
               {"parts", parts_json(info)},
               {"segments", segments_json(info)},
               {"layers", layers_json(info)},
               {"streams", streams_json(info)}};
  if (info.start_camera) json["start_camera"] = camera_json(*info.start_camera);
  if (info.has_up()) {
    json["up"] = vector_json(m.up);
    json["floor"] = vector_json(m.floor);
  }
  if (!info.audio.empty()) {
    json["audio"] = {{"location", info.audio}, {"begin_s", m.audio_begin_seconds}};
  }
  if (info.contents.is_window != 0) {
    json["window"] = {{"first_frame", info.contents.window_first_frame},
                      {"capture_frames", info.contents.capture_frames}};
  }
  return json;
}

Json statistics_json(const stgs_scene_statistics& s) {
  return {{"never_visible", s.never_visible},
          {"lifespans",
           {{"bins_s", bins_json(s.lifespans, s.lifespan_bins)},
            {"whole_clip", s.whole_clip},
            {"median_s", s.median_lifespan}}},
          {"speeds", {{"bins", bins_json(s.speeds, s.speed_bins)}, {"median", s.median_speed}}},
          {"static",
           {{"primitives", s.static_primitives},
            {"share", s.static_share},
            {"bound", s.static_bound},
            {"scene_radius", s.scene_radius},
            {"whole_clip_drift", s.whole_clip_drift}}}};
}

}  // namespace stgs::tools
