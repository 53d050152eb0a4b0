// SPDX-License-Identifier: Apache-2.0
#include "scene_info.h"

#include <algorithm>

namespace stgs::tools {
namespace {

// Reads `count` elements with get(scene, index, &element).
template <typename T, typename Get>
Status read_list(const SceneFile& file, std::uint32_t count, Get get, std::vector<T>& list) {
  for (std::uint32_t i = 0; i < count; ++i) {
    list.push_back(sized<T>());
    STGS_TRY(file.check(get(file.get(), i, &list.back())));
  }
  return {};
}

}  // namespace

bool SceneInfo::has_up() const {
  return std::any_of(scene.up, scene.up + 3, [](float v) { return v != 0.0f; });
}

std::size_t SceneInfo::count_segments() const {
  return static_cast<std::size_t>(
      std::count_if(segments.begin(), segments.end(),
                    [](const stgs_segment& segment) { return segment.tier == 0; }));
}

std::vector<SceneLayer> SceneInfo::layers() const {
  std::vector<SceneLayer> primitives, sh;
  for (const stgs_segment& segment : segments) {
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

bool SceneInfo::has_stream_bytes() const {
  return std::any_of(streams.begin(), streams.end(),
                     [](const stgs_stream& stream) { return stream.bytes > 0; });
}

std::optional<double> SceneInfo::mean_kbps() const {
  if (scene.frames <= 1) return std::nullopt;
  return 8e-3 * static_cast<double>(scene.file_bytes) / scene.duration_seconds;
}

double SceneInfo::bytes_per_primitive() const {
  return scene.primitives == 0
             ? 0
             : static_cast<double>(scene.file_bytes) / static_cast<double>(scene.primitives);
}

Result<SceneInfo> read_info(const SceneFile& file) {
  SceneInfo info;
  info.name = file.name();
  info.profile = file.text(STGS_TEXT_PROFILE);
  info.generator = file.text(STGS_TEXT_GENERATOR);
  info.title = file.text(STGS_TEXT_TITLE);
  info.audio = file.text(STGS_TEXT_AUDIO);
  info.scene = sized<stgs_scene_info>();
  info.contents = sized<stgs_contents>();
  info.decoder = sized<stgs_decoder_needs>();
  STGS_TRY(file.check(stgs_scene_get_info(file.get(), &info.scene)));
  STGS_TRY(file.check(stgs_scene_get_contents(file.get(), &info.contents)));
  STGS_TRY(file.check(stgs_scene_get_decoder_needs(file.get(), &info.decoder)));
  if (info.scene.has_start_camera != 0) {
    info.start_camera = sized<stgs_view>();
    STGS_TRY(file.check(stgs_scene_start_view(file.get(), &*info.start_camera)));
  }
  const stgs_contents& contents = info.contents;
  STGS_TRY(read_list(file, info.scene.issues, stgs_scene_get_issue, info.issues));
  STGS_TRY(
      read_list(file, contents.lost_fragments, stgs_scene_get_lost_fragment, info.lost_fragments));
  STGS_TRY(read_list(file, contents.parts, stgs_scene_get_part, info.parts));
  STGS_TRY(read_list(file, contents.segments, stgs_scene_get_segment, info.segments));
  STGS_TRY(read_list(file, contents.streams, stgs_scene_get_stream, info.streams));
  return info;
}

Result<stgs_scene_statistics> read_statistics(SceneFile& file) {
  auto statistics = sized<stgs_scene_statistics>();
  file.set_log_warnings(true);  // of damage
  Status status = file.check(stgs_scene_get_statistics(file.get(), &statistics));
  file.set_log_warnings(false);
  if (!status.ok()) return status;
  return statistics;
}

}  // namespace stgs::tools
