// SPDX-License-Identifier: Apache-2.0
// Prints encoding and decoding speed, size by attribute and error of both profiles, and the coders
// by attribute, as JSON.
//   bench_codec [SCENE.stgs | PRIMITIVES [SH_DEGREE]]

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>
#include <string_view>

#include "../fixtures/scene_fixture.h"
#include "coder_table.h"
#include "recycling_memory.h"
#include "stgs/format/raster.h"
#include "stgs/format/thread_pool.h"

using namespace stgs;

namespace {

// The minimum of several runs. The CPU time of all threads hardly depends on other programs.
struct Time {
  double elapsed = 1e30, cpu = 1e30;  // seconds
};

template <typename Work>
Time min_time(Work work, int runs = 3) {
  Time best;
  for (int run = 0; run < runs; ++run) {
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t start_cpu = std::clock();
    work();
    const double cpu =
        static_cast<double>(std::clock() - start_cpu) / static_cast<double>(CLOCKS_PER_SEC);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    best.elapsed = std::min(best.elapsed, took.count());
    best.cpu = std::min(best.cpu, cpu);
  }
  return best;
}

math::PinholeCamera camera_of(const SceneMetadata& metadata) {
  const StartCamera start = metadata.start_camera.value_or([] {
    StartCamera camera;
    camera.width = 640;
    camera.height = 480;
    camera.fx = camera.fy = 576.0f;
    camera.cx = 320.0f;
    camera.cy = 240.0f;
    return camera;
  }());
  return pinhole_of(start, metadata.near_plane);
}

double psnr(const Scene& a, const Scene& b) {
  SplatFrame splats;
  RasterOutput left, right;
  double squared = 0.0;
  std::size_t samples = 0;
  for (float progress : {0.1f, 0.5f, 0.83f}) {
    const float t = progress * static_cast<float>(a.metadata.frames);
    render(a.gaussians, t, camera_of(a.metadata), {}, splats, left);
    render(b.gaussians, t, camera_of(a.metadata), {}, splats, right);
    for (std::size_t i = 0; i < left.colour.data.size(); ++i) {
      const double d = std::min(1.0f, left.colour.data[i]) - std::min(1.0f, right.colour.data[i]);
      squared += d * d;
      ++samples;
    }
  }
  return -10.0 * std::log10(std::max(1e-20, squared / static_cast<double>(samples)));
}

nlohmann::json measure(const Scene& scene, const WriteSettings& settings) {
  std::vector<std::uint8_t> bytes;
  const Time encode = min_time([&] {
    auto result = encode_scene(scene, settings);
    if (result.ok()) bytes = std::move(*result);
  });
  std::optional<Scene> decoded;
  const Time decode = min_time([&] {
    auto result = read_scene(memory_source(bytes));
    if (result.ok()) decoded = std::move(*result);
  });
  const auto reader =
      SceneReader::open(memory_source(bytes), ReadLimits(), &player::segment_memory());
  if (!reader.ok() || !decoded) return {{"error", reader.status().message()}};
  const auto n = static_cast<double>((*reader)->primitives());
  // Decodes like a player: each segment into its own arrays, ready to be rendered, in memory that
  // earlier segments have used.
  bool complete = true;
  const auto segments = static_cast<std::uint32_t>((*reader)->segments().size());
  const Time by_segment = min_time(
      [&] {
        for (std::uint32_t s = 0; s < segments; ++s)
          complete = (*reader)->decode(s).ok() && complete;
      },
      40);
  if (!complete) return {{"error", "a segment cannot be decoded"}};
  nlohmann::json out = {{"primitives", (*reader)->primitives()},
                        {"segments", (*reader)->segments().size()},
                        {"bytes", bytes.size()},
                        {"bytes_per_primitive", static_cast<double>(bytes.size()) / n},
                        {"encode_primitives_per_s", n / encode.elapsed},
                        {"encode_primitives_per_cpu_s", n / encode.cpu},
                        {"decode_primitives_per_s", n / decode.elapsed},
                        {"decode_primitives_per_cpu_s", n / decode.cpu},
                        {"segment_decode_primitives_per_cpu_s", n / by_segment.cpu},
                        {"psnr_to_source_db", psnr(scene, *decoded)}};
  for (const StreamInfo& stream : (*reader)->streams()) {
    out["bytes_per_primitive_by_attribute"][stream.name] = static_cast<double>(stream.bytes) / n;
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view input = argc > 1 ? argv[1] : "200000";
  std::size_t n = 0;
  Scene scene;
  if (std::from_chars(input.data(), input.data() + input.size(), n).ec == std::errc{}) {
    const int degree = argc > 2 ? std::clamp(std::atoi(argv[2]), 0, 3) : 3;
    scene = testing::random_scene(n, degree, 60, 11);
  } else {
    auto read = read_scene(std::string(input));
    if (!read.ok()) {
      std::fprintf(stderr, "%s\n", read.status().message().c_str());
      return static_cast<int>(read.status().code());
    }
    scene = std::move(*read);
  }
  nlohmann::json out;
  for (int threads : {1, 0}) {
    const std::unique_ptr<ThreadPool> pool =
        threads == 1 ? std::make_unique<ThreadPool>(1) : nullptr;
    const ScopedTaskRunner use(pool.get());
    nlohmann::json& row = out[threads == 1 ? "one_thread" : "all_threads"];
    row["lossless"] = measure(scene, {});
    for (int quality : {60, 85, 87, 95}) {
      WriteSettings settings;
      settings.profile = Profile::kQuantised;
      settings.quality = quality;
      row[fmt::format("quality_{}", quality)] = measure(scene, settings);
    }
    if (threads == 1) row["coders"] = bench::coder_table(scene);
  }
  std::printf("%s\n", out.dump(2).c_str());
  return 0;
}
