// SPDX-License-Identifier: Apache-2.0
// Frames a second of the player on the CPU, as JSON: plays a scene in order, again and again, from
// its start camera or a camera file, at 640x360 and 1280x720. Drawing only; decoding happens in the
// first round, which is not counted.
//
// usage: bench_player SCENE.stgs [CAMERA.json] [SECONDS]

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "camera_file.h"
#include "session.h"
#include "stgs/format/parallel.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {
namespace {

Result<Json> play(const std::string& path, const encoder::Camera& camera, double limit) {
  STGS_ASSIGN(auto timeline, player::Timeline::open(path));
  STGS_ASSIGN(auto renderer, player::make_renderer("cpu"));
  const SceneMetadata& metadata = timeline->metadata();
  const float* b = metadata.background;
  const player::View view{camera.pinhole(metadata.near_plane), {b[0], b[1], b[2]}};
  std::vector<player::Frame> frames;
  player::RenderStats stats, sums;
  std::vector<double> milliseconds;
  double begin = 0;
  for (int round = 0; round == 0 || now_seconds() - begin < limit; ++round) {
    if (round == 1) begin = now_seconds();
    for (std::uint32_t i = 0; i < metadata.frames; ++i) {
      const double start = now_seconds();
      STGS_TRY(renderer->render(*timeline, metadata.time_base.seconds(i), {view}, frames, &stats));
      if (round == 0) continue;
      milliseconds.push_back(1000 * (now_seconds() - start));
      sums.active += stats.active;
      sums.splats += stats.splats;
      sums.fetch_ms += stats.fetch_ms;
      sums.slice_ms += stats.slice_ms;
      sums.bin_ms += stats.bin_ms;
      sums.blend_ms += stats.blend_ms;
    }
    if (round == 0) begin = now_seconds();
  }
  const auto n = static_cast<double>(milliseconds.size());
  double total = 0;
  for (double ms : milliseconds) total += ms;
  std::sort(milliseconds.begin(), milliseconds.end());
  const auto at = [&](double share) {
    return milliseconds[static_cast<std::size_t>(share * (n - 1))];
  };
  return Json{{"width", camera.width},
              {"height", camera.height},
              {"frames", milliseconds.size()},
              {"fps", 1000 * n / total},
              {"ms", {{"median", at(0.5)}, {"p99", at(0.99)}, {"worst", at(1)}}},
              {"mean_ms",
               {{"fetch", sums.fetch_ms / n},
                {"slice", sums.slice_ms / n},
                {"bin", sums.bin_ms / n},
                {"blend", sums.blend_ms / n}}},
              {"active", static_cast<double>(sums.active) / n},
              {"rendered", static_cast<double>(sums.splats) / n},
              {"decoded_bytes", timeline->memory_bytes()}};
}

Result<encoder::Camera> find_camera(const std::string& scene, const char* path) {
  if (path != nullptr) return read_camera(path);
  STGS_ASSIGN(const auto reader, SceneReader::open(scene));
  if (!reader->metadata().start_camera) return usage_error("{}: has no start camera", scene);
  return camera_of(*reader->metadata().start_camera, scene);
}

Status bench(int argc, char** argv) {
  if (argc < 2) return usage_error("usage: bench_player SCENE.stgs [CAMERA.json] [SECONDS]");
  STGS_ASSIGN(const encoder::Camera camera, find_camera(argv[1], argc > 2 ? argv[2] : nullptr));
  const double limit = argc > 3 ? std::strtod(argv[3], nullptr) : 5;
  Json json = {{"scene", argv[1]},
               {"vector_target", vector_target()},
               {"threads", concurrency()},
               {"sizes", Json::array()}};
  for (const Size size : {Size{640, 360}, Size{1280, 720}}) {
    STGS_ASSIGN(Json result, play(argv[1], resized(camera, size), limit));
    json["sizes"].push_back(result);
  }
  json["peak_memory"] = peak_memory();
  std::puts(json.dump(1).c_str());
  return {};
}

}  // namespace
}  // namespace stgs::tools

int main(int argc, char** argv) {
  const stgs::Status status = stgs::tools::bench(argc, argv);
  if (!status.ok()) std::fprintf(stderr, "bench_player: %s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
