// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "camera_file.h"
#include "command.h"
#include "losses.h"
#include "options.h"
#include "place.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {
namespace {

// Dynamics for a model that has none: those of tests/bench/RESULTS.md's comparisons.
constexpr std::uint32_t kAnimatedFrames = 300, kAnimatedRate = 30;
constexpr double kBriefShare = 0.3;
constexpr float kBriefSigma = 3, kLongSigma = 900, kAnimatedRadius = 1e-6f;  // frames
constexpr double kAnimatedSpeed = 1e-3;   // scene units a frame, at most, an axis
constexpr double kHarmonicsSpread = .02;  // standard deviation of those that a model lacks

// Uniform in [0, 1), the same on every machine.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}

void animate(Scene& scene, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Gaussians4D& set = scene.gaussians;
  scene.metadata.time_base = {1, kAnimatedRate};
  scene.metadata.frames = kAnimatedFrames;
  scene.parts.clear();
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.time[i] = static_cast<float>(uniform(random) * kAnimatedFrames);
    set.sigma[i] = uniform(random) < kBriefShare ? kBriefSigma : kLongSigma;
    set.radius[i] = kAnimatedRadius;
    for (int axis = 0; axis < 3; ++axis) {
      set.velocity[3 * i + axis] = static_cast<float>((2 * uniform(random) - 1) * kAnimatedSpeed);
    }
  }
}

// One of the normal distribution, the same on every machine up to its library's rounding.
double normal(std::mt19937_64& random) {
  const double radius = std::sqrt(-2 * std::log(1 - uniform(random)));
  return radius * std::cos(2 * std::numbers::pi * uniform(random));
}

// All harmonics to degree 3; those that the model lacks are random.
void fill_harmonics(Gaussians4D& set, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto have = 3 * static_cast<std::size_t>(set.sh_coefficients());
  set.sh_degree = math::kShMaxDegree;
  const auto want = 3 * static_cast<std::size_t>(set.sh_coefficients());
  std::vector<float> sh(want * set.size());
  for (std::size_t i = 0; i < set.size(); ++i) {
    for (std::size_t k = 0; k < want; ++k) {
      sh[want * i + k] =
          k < have ? set.sh[have * i + k] : static_cast<float>(kHarmonicsSpread * normal(random));
    }
  }
  set.sh.swap(sh);
}

// What one pass over all pictures took, milliseconds a picture.
struct Pass {
  std::vector<double> frame, fetch, slice, bin, blend, device;

  void add(double total, const player::RenderStats& stats) {
    frame.push_back(total);
    fetch.push_back(stats.fetch_ms);
    slice.push_back(stats.slice_ms);
    bin.push_back(stats.bin_ms);
    blend.push_back(stats.blend_ms);
    device.push_back(stats.device_ms);
  }
};

// The least value that the share of all values does not exceed; not of nothing.
double percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  const double rank = std::ceil(share * static_cast<double>(values.size()));
  return values[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

Json to_json(const std::vector<double>& values) {
  return {{"mean", mean(values)},
          {"p50", percentile(values, 0.5)},
          {"p95", percentile(values, 0.95)},
          {"p99", percentile(values, 0.99)}};
}

Json to_json(const Pass& pass) {
  return {{"fps", 1e3 / percentile(pass.frame, 0.5)},
          {"frame_ms", to_json(pass.frame)},
          {"fetch_ms", to_json(pass.fetch)},
          {"slice_ms", to_json(pass.slice)},
          {"bin_ms", to_json(pass.bin)},
          {"blend_ms", to_json(pass.blend)},
          {"device_ms", to_json(pass.device)}};
}

std::string to_text(const char* name, const Pass& pass) {
  std::string text =
      fmt::format("{:<8} {:>10} {:>10} {:>10} {:>10}\n", name, "mean ms", "p50", "p95", "p99");
  const auto row = [&text](const char* stage, const std::vector<double>& values) {
    text +=
        fmt::format("  {:<6} {:>10.3f} {:>10.3f} {:>10.3f} {:>10.3f}\n", stage, mean(values),
                    percentile(values, 0.5), percentile(values, 0.95), percentile(values, 0.99));
  };
  row("frame", pass.frame);
  row("fetch", pass.fetch);
  row("slice", pass.slice);
  row("bin", pass.bin);
  row("blend", pass.blend);
  if (percentile(pass.device, 1) > 0) row("device", pass.device);
  return text;
}

class Bench final : public Command {
 public:
  Help help() const override {
    return {"bench", "Measure how fast a .stgs file is drawn",
            "Draws pictures at moments spread evenly over the file, from the given cameras in\n"
            "turn, twice: the first pass decodes what it needs (fetch), the second finds it held,\n"
            "as far as --memory goes. frame: all of a picture, which stays on the device that\n"
            "drew it; slice: what is visible at the moment, projected; bin: into tiles, in order;\n"
            "blend: the pixels; device: these three by the clock of a GPU. Milliseconds a\n"
            "picture, over the pictures of a pass; fps is 1000 over the median. --animate gives\n"
            "each primitive of a model lifespans and speeds for comparing renderers: 300 frames,\n"
            "T uniform in them, sigma 3 frames for 30 % and 900 for the rest, r nearly 0, speeds\n"
            "to .001 units a frame and axis. --full-harmonics gives a model of lower degree\n"
            "random ones up to degree 3. The whole file is then held lossless in memory.",
            "  stgs bench scene.stgs --size 3840x2160\n"
            "  stgs bench model.stgs --animate --camera a.json --camera b.json --format json"};
  }

  Shared shared() const override {
    return {.progress = true, .backend = "What draws", .threads = true, .seed = true};
  }
  void declare(CLI::App& app) override {
    app.add_option("FILE", file_, "The .stgs file, or its URL")->required();
    app.add_option("--camera", camera_files_,
                   "Camera file (JSON), as for render; may be given again. Else the file's own");
    app.add_option("--size", size_, "WIDTHxHEIGHT in pixels; the view angle is kept an axis each");
    app.add_option("--pictures", pictures_, "How many a pass draws")
        ->check(number_between(1, 1e6))
        ->capture_default_str();
    app.add_flag("--animate", animate_, "Give the primitives lifespans and speeds of a comparison");
    app.add_flag("--full-harmonics", full_harmonics_,
                 "Give the primitives harmonics to degree 3, random where they have none");
    app.add_option("--memory", memory_mb_, "Decoded data held at most, MB (10^6 bytes)")
        ->check(number_between(1, 1e9))
        ->capture_default_str();
  }

  Status run(Session& session) override {
    STGS_ASSIGN(auto reader, open(session));
    const std::uint64_t primitives = reader->primitives();
    const auto timeline = player::Timeline::over(std::move(reader), file_,
                                                 static_cast<std::uint64_t>(memory_mb_ * 1e6),
                                                 player::Damaged::kPassOver);
    tell_damage(session, *timeline);
    STGS_ASSIGN(auto renderer, player::make_renderer(session.options.backend));
    STGS_ASSIGN(const auto cameras, find_cameras(timeline->metadata()));
    Pass passes[2];
    for (int pass = 0; pass < 2; ++pass) {
      for (int i = 0; i < pictures_; ++i) {
        const auto& camera = cameras[static_cast<std::size_t>(i) % cameras.size()];
        STGS_TRY(draw(*timeline, *renderer, camera, i, passes[pass]));
        if (!session.progress("bench", static_cast<std::size_t>(pass * pictures_ + i + 1),
                              static_cast<std::size_t>(2 * pictures_))) {
          return runtime_error("the measurement is not complete");
        }
      }
    }
    tell_losses(session, *timeline);
    return report(session, *timeline, primitives, renderer->name(), cameras, passes);
  }

 private:
  Result<std::unique_ptr<SceneReader>> open(Session& session) const {
    if (!animate_ && !full_harmonics_) return open_scene(session, file_);
    STGS_ASSIGN(Scene scene, read_place(session, file_));
    if (animate_) animate(scene, session.options.seed);
    if (full_harmonics_) fill_harmonics(scene.gaussians, session.options.seed + 1);
    WriteSettings settings;
    settings.zstd_level = 1;
    STGS_ASSIGN(std::vector<std::uint8_t> bytes, encode_scene(scene, settings));
    return SceneReader::open(memory_source(std::move(bytes), file_));
  }

  Result<std::vector<encoder::Camera>> find_cameras(const SceneMetadata& metadata) const {
    std::vector<encoder::Camera> cameras;
    for (const std::string& path : camera_files_) {
      STGS_ASSIGN(const encoder::Camera camera, read_camera(path));
      cameras.push_back(camera);
    }
    if (cameras.empty()) {
      if (!metadata.start_camera) {
        return usage_error("{}: has no start camera; give --camera", file_);
      }
      STGS_ASSIGN(const encoder::Camera camera, camera_of(*metadata.start_camera, file_));
      cameras.push_back(camera);
    }
    if (!size_.empty()) {
      STGS_ASSIGN(const Size size, parse_size(size_));
      for (encoder::Camera& camera : cameras) camera = resized(camera, size);
    }
    return cameras;
  }

  Status draw(player::Timeline& timeline, player::Renderer& renderer, const encoder::Camera& camera,
              int picture, Pass& pass) {
    const SceneMetadata& metadata = timeline.metadata();
    const double seconds = timeline.duration_seconds() * (picture + 0.5) / pictures_;
    const float* b = metadata.background;
    const player::View view{camera.pinhole(metadata.near_plane), {b[0], b[1], b[2]}};
    player::RenderStats stats;
    const double begin = now_seconds();
    STGS_TRY(at_moment(renderer.draw(timeline, seconds, {view}, &stats), file_, seconds));
    pass.add(1e3 * (now_seconds() - begin), stats);
    stored_ = std::max(stored_, stats.stored);
    alive_ += static_cast<double>(stats.alive) / (2.0 * pictures_);
    drawn_ += static_cast<double>(stats.drawn) / (2.0 * pictures_);
    return {};
  }

  Status report(Session& session, const player::Timeline& timeline, std::uint64_t primitives,
                const std::string& backend, const std::vector<encoder::Camera>& cameras,
                const Pass (&passes)[2]) const {
    Json sizes = Json::array();
    for (const encoder::Camera& camera : cameras) {
      sizes.push_back({{"width", camera.width}, {"height", camera.height}});
    }
    const Json json = {{"file", file_},
                       {"backend", backend},
                       {"threads", concurrency()},
                       {"animated", animate_},
                       {"full_harmonics", full_harmonics_},
                       {"primitives", primitives},
                       {"lost", losses_json(timeline)},
                       {"stored", stored_},
                       {"alive", alive_},
                       {"drawn", drawn_},
                       {"cameras", sizes},
                       {"pictures", pictures_},
                       {"first", to_json(passes[0])},
                       {"again", to_json(passes[1])},
                       {"peak_memory", peak_memory()}};
    const std::string text = fmt::format(
        "{} on {} threads, {}x{}{}: {} pictures a pass of {} primitives, {:.0f} alive "
        "and {:.0f} drawn at a moment\n{}{}{:.1f} pictures a second, peak memory {}\n",
        backend, concurrency(), cameras[0].width, cameras[0].height,
        cameras.size() > 1 ? " and others" : "", pictures_, primitives, alive_, drawn_,
        to_text("first", passes[0]), to_text("again", passes[1]),
        1e3 / percentile(passes[1].frame, 0.5), human_bytes(peak_memory()));
    return session.emit(json, text);
  }

  std::string file_, size_;
  std::vector<std::string> camera_files_;
  int pictures_ = 40;
  bool animate_ = false, full_harmonics_ = false;
  double memory_mb_ = 4096;
  std::size_t stored_ = 0;
  double alive_ = 0, drawn_ = 0;
};

}  // namespace

std::unique_ptr<Command> make_bench() {
  return std::make_unique<Bench>();
}

}  // namespace stgs::tools
