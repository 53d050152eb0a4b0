// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <optional>

#include "bench_measure.h"
#include "bench_model.h"
#include "bench_play.h"
#include "camera_file.h"
#include "command.h"
#include "damage.h"
#include "options.h"
#include "scene_input.h"
#include "stgs/format/parallel.h"
#include "stgs/player/renderer.h"
#include "usage.h"

namespace stgs::tools {
namespace {

// Offset of the principal point of each eye towards the nose, as a fraction of the image width.
constexpr float kNasalShift = 0.05f;

class Bench final : public Command {
 public:
  Help help() const override {
    return {
        "bench", "Measure rendering performance of a .stgs file",
        "Renders frames at times spread evenly over the clip, from the given cameras in turn, in\n"
        "two passes. The cold pass fetches and decodes the segments; the warm pass finds them in\n"
        "memory, within --memory. Reports milliseconds per frame over the frames of a pass; fps\n"
        "is 1000 / median. Rows: frame (the entire frame), fetch (find and decode segments), "
        "slice\n"
        "(evaluate and project the active primitives), bin (sort into tiles), blend (compute\n"
        "pixels), device (slice, bin and blend by the GPU clock). Frames stay on the device that\n"
        "rendered them.\n"
        "--stereo renders two eyes in one call. A third pass renders the left eye alone: with\n"
        "--fovea at full resolution, followed by a fourth pass with the fovea.\n"
        "--steps renders each warm frame once more, step by step, and reports the time of each\n"
        "step next to its lower bound from memory bandwidth and arithmetic (cuda) or from memory\n"
        "bandwidth only (vulkan).\n"
        "--play renders frames in order against a display clock instead. 'timeline' decodes a\n"
        "frame when it is rendered, on the backend's device; 'player' fetches and decodes ahead\n"
        "on the CPU. A frame that is not ready when the next one is due is missed.\n"
        "Synthetic scenes, for renderer comparisons: --animate adds lifespans and speeds to a\n"
        "model (300 frames, T uniform, sigma 3 frames for 30 % of the primitives and 900 for the\n"
        "rest, r nearly 0, speeds up to 0.001 units per frame and axis). --stored-ratio N splits\n"
        "each primitive into N consecutive ones: the same number is active, N times as many are\n"
        "stored. --full-sh extends SH to degree 3 with random coefficients. The synthetic scene\n"
        "is benchmarked from memory, as a lossless file or packed with --quality.",
        "  stgs bench scene.stgs --size 3840x2160\n"
        "  stgs bench scene.stgs --size 2064x2208 --stereo 0.063 --fovea 500\n"
        "  stgs bench scene.stgs --play player --frames 300\n"
        "  stgs bench model.stgs --animate --camera a.json --camera b.json --format json"};
  }

  Shared shared() const override {
    return {.progress = true, .backend = "Renderer", .threads = true, .urls = true};
  }
  void declare(Arguments& app) override {
    app.add_option("FILE", file_, "The .stgs file: a path, a URL, or - for standard input")
        ->required();
    app.add_option("--camera", camera_files_,
                   "Camera file (JSON), as for render; repeatable (default: the start camera)");
    app.add_option(
        "--size", size_,
        "Frame size WIDTHxHEIGHT in pixels; stretches the image if the aspect ratio differs");
    auto* num_frames = app.add_option("--num-frames", num_frames_, "Frames per pass");
    num_frames->check(number_between(1, 1e6))->capture_default_str();
    app.add_option("--stereo", eye_distance_, "Render two eyes at this distance, scene units")
        ->check(number_between(0, 1e6));
    app.add_option("--fovea", fovea_radius_,
                   "Full resolution within this radius around the camera axis, half beyond, pixels")
        ->check(number_between(0, 1e6));
    auto* steps = app.add_flag("--steps", steps_,
                               "Report the time and the lower bound of each rendering step");
    auto* play =
        with_choices(app.add_option("--play", pipeline_, "Benchmark playback through this pipeline")
                         ->excludes(steps)
                         ->excludes(num_frames),
                     {"timeline", "player"});
    app.add_option("--frames", play_.frames, "Frames of the clip to play")
        ->needs(play)
        ->check(number_between(1, 1e6))
        ->capture_default_str();
    app.add_option("--refresh", play_.refresh, "Display refreshes per second of --play")
        ->needs(play)
        ->check(number_between(1, 1e4))
        ->capture_default_str();
    app.add_option("--rate", play_.rate, "Playback rate of --play")
        ->needs(play)
        ->check(number_between(0.01, 4))
        ->capture_default_str();
    auto* animate =
        app.add_flag("--animate", animate_, "Add lifespans and speeds to a static model");
    app.add_option("--stored-ratio", stored_ratio_,
                   "Split each primitive into this many consecutive ones")
        ->excludes(animate)
        ->check(number_between(1, 1000));
    app.add_flag("--full-sh", full_sh_, "Extend SH to degree 3 with random coefficients");
    app.add_option("--quality", quality_,
                   "Pack the synthetic scene with this quality, 0 to 100 (default: lossless)")
        ->check(number_between(kQuality.min, kQuality.max));
    app.add_option("--seed", seed_, "Seed of the synthetic scene (default: 1)")
        ->check(check_integer);
    app.add_option("--memory", memory_, "Memory for decoded data, for example 512M or 8G")
        ->check(accepted_by<parse_memory>)
        ->capture_default_str();
  }

  Status run(Session& session) override {
    STGS_ASSIGN(const std::uint64_t budget, parse_memory(memory_));
    const ReadLimits limits = ReadLimits::of(ReadLimits().max_primitives, budget);
    STGS_ASSIGN(auto source, open(session, limits));
    STGS_ASSIGN(auto renderer, player::make_renderer(session.options.backend));
    if (pipeline_ == "player") {
      STGS_ASSIGN(auto playback,
                  playback_of(std::move(source), budget, play_.rate, session.options.timeout));
      return run_play(session, *playback, *renderer);
    }
    STGS_ASSIGN(auto reader, SceneReader::open(std::move(source), limits));
    auto timeline = player::Timeline::from_reader(std::move(reader), shown_file(), budget,
                                                  player::DamagePolicy::kSkip);
    if (pipeline_ == "timeline") {
      const auto playback = playback_of(std::move(timeline), play_.rate);
      return run_play(session, *playback, *renderer);
    }
    return run_passes(session, *timeline, *renderer);
  }

 private:
  std::string shown_file() const { return display_name(file_); }

  Result<std::unique_ptr<ByteSource>> open(Session& session, const ReadLimits& limits) const {
    if (!animate_ && !full_sh_ && stored_ratio_ == 0) {
      if (!quality_ && !seed_) return open_source(session, file_, limits.max_memory);
      return usage_error(
          "{} applies to a synthetic scene; add --animate, --stored-ratio or --full-sh",
          quality_ ? "--quality" : "--seed");
    }
    // --memory is for playing the synthetic scene, not for making it.
    STGS_ASSIGN(Scene scene, load_scene(session, file_));
    const std::uint64_t limit = ReadLimits{}.max_primitives;
    if (stored_ratio_ > 0 &&
        scene.gaussians.size() > limit / static_cast<std::uint64_t>(stored_ratio_)) {
      return usage_error("{}: --stored-ratio {} makes {} primitives of {}; a file holds at most {}",
                         shown_file(), stored_ratio_,
                         scene.gaussians.size() * static_cast<std::uint64_t>(stored_ratio_),
                         scene.gaussians.size(), limit);
    }
    const std::uint64_t seed = seed_.value_or(1);
    if (animate_) animate(scene, seed);
    if (full_sh_) extend_sh(scene.gaussians, seed + 1);
    if (interrupted()) return runtime_error("the synthetic scene is not complete");
    if (stored_ratio_ > 0) multiply_stored(scene, stored_ratio_, seed);
    WriteSettings settings;
    settings.stop = session.stop_token();
    if (quality_) {
      settings.profile = Profile::kQuantised;
      settings.quality = *quality_;
    }
    STGS_ASSIGN(std::vector<std::uint8_t> bytes, encode_scene(scene, settings));
    return memory_source(std::move(bytes), shown_file());
  }

  Result<std::vector<encoder::Camera>> find_cameras(const SceneMetadata& metadata) const {
    std::vector<encoder::Camera> cameras;
    for (const std::string& path : camera_files_) {
      STGS_ASSIGN(const encoder::Camera camera, read_camera(path));
      cameras.push_back(camera);
    }
    if (cameras.empty()) {
      if (!metadata.start_camera) {
        return usage_error("{}: no start camera; use --camera", shown_file());
      }
      STGS_ASSIGN(const encoder::Camera camera, camera_of(*metadata.start_camera, shown_file()));
      cameras.push_back(camera);
    }
    if (!size_.empty()) {
      STGS_ASSIGN(const Size size, parse_size(size_));
      for (encoder::Camera& camera : cameras) camera = resized(camera, size);
    }
    return cameras;
  }

  // Returns the views of a frame: the camera, or two eyes around it, left first.
  std::vector<player::View> views_of(const encoder::Camera& camera,
                                     const SceneMetadata& metadata) const {
    const float* b = metadata.background;
    const player::View view{camera.pinhole(metadata.near_plane), {b[0], b[1], b[2]}};
    std::vector<player::View> eyes(eye_distance_ ? 2 : 1, view);
    if (eye_distance_) separate_eyes(eyes);
    for (player::View& eye : eyes) {
      if (fovea_radius_) eye.fovea = Fovea{{eye.camera.cx, eye.camera.cy}, *fovea_radius_};
    }
    return eyes;
  }

  void separate_eyes(std::vector<player::View>& eyes) const {
    for (int eye = 0; eye < 2; ++eye) {
      math::PinholeCamera& pinhole = eyes[static_cast<std::size_t>(eye)].camera;
      const float side = eye == 0 ? 1.0f : -1.0f;
      pinhole.translation.x += side * 0.5f * static_cast<float>(*eye_distance_);
      pinhole.cx += side * kNasalShift * pinhole.width;
    }
  }

  struct Measured {
    // Cold, warm; with --stereo one eye without a fovea; with --fovea too, one eye with it.
    std::vector<Pass> passes;
    StepTable steps;
  };

  Result<Measured> measure(Session& session, player::Timeline& timeline, player::Renderer& renderer,
                           const std::vector<encoder::Camera>& cameras) const {
    Measured out;
    out.passes.resize(!eye_distance_ ? 2 : fovea_radius_ ? 4 : 3);
    const auto frames = static_cast<std::size_t>(num_frames_), all = out.passes.size() * frames;
    for (std::size_t k = 0; k < all; ++k) {
      const std::size_t pass = k / frames, frame = k % frames;
      std::vector<player::View> views =
          views_of(cameras[frame % cameras.size()], timeline.metadata());
      if (pass >= 2) views.resize(1);
      if (pass == 2) views[0].fovea.reset();
      const double seconds =
          timeline.duration_seconds() * (static_cast<double>(frame) + 0.5) / num_frames_;
      player::RenderStats stats;
      const double begin = now_seconds();
      STGS_TRY(
          with_render_time(renderer.draw(timeline, seconds, views, &stats), shown_file(), seconds));
      out.passes[pass].add(1e3 * (now_seconds() - begin), stats);
      // Fail at once if the backend has no profile, not after the cold pass.
      if (steps_ && k == 0) STGS_TRY(renderer.profile().status());
      if (steps_ && pass == 1) {
        STGS_ASSIGN(const player::RenderProfile profile, renderer.profile());
        out.steps.add(profile);
      }
      if (!session.progress("bench", k + 1, all)) {
        return runtime_error("the benchmark is not complete");
      }
    }
    return out;
  }

  Status run_passes(Session& session, player::Timeline& timeline, player::Renderer& renderer) {
    warn_of_open_damage(session, timeline);
    STGS_ASSIGN(const auto cameras, find_cameras(timeline.metadata()));
    STGS_ASSIGN(const Measured measured, measure(session, timeline, renderer, cameras));
    warn_of_damage(session, timeline);
    const Pass &cold = measured.passes[0], &warm = measured.passes[1];
    Json json = head(timeline, renderer, cameras, warm);
    json["num_frames"] = num_frames_;
    json["cold"] = to_json(cold);
    json["warm"] = to_json(warm);
    std::string text = head_text(timeline, renderer, cameras, warm) + to_text("cold", cold) +
                       to_text("warm", warm);
    if (eye_distance_) {
      const Pass& one = measured.passes[2];
      const double ratio = percentile(warm.frame, 0.5) / percentile(one.frame, 0.5);
      json["stereo"] = {
          {"eye_distance", *eye_distance_}, {"one_eye", to_json(one)}, {"ratio_to_one_eye", ratio}};
      text += to_text("one eye", one) +
              fmt::format("two eyes take {:.3f} times as long{}\n", ratio,
                          fovea_radius_ ? " as one without fovea" : " as one");
      if (fovea_radius_) {
        const Pass& foveated = measured.passes[3];
        json["stereo"]["one_eye_foveated"] = to_json(foveated);
        const double ratio_foveated = percentile(warm.frame, 0.5) / percentile(foveated.frame, 0.5);
        json["stereo"]["ratio_to_one_eye_foveated"] = ratio_foveated;
        text +=
            to_text("foveated", foveated) +
            fmt::format("two eyes take {:.3f} times as long as one with fovea\n", ratio_foveated);
      }
    }
    if (steps_) {
      json["steps"] = measured.steps.to_json();
      text += measured.steps.to_text();
    }
    json["peak_memory"] = peak_memory();
    text += fmt::format("{:.1f} fps, peak memory {}\n", 1e3 / percentile(warm.frame, 0.5),
                        human_bytes(peak_memory()));
    return session.emit(json, text);
  }

  Status run_play(Session& session, MeasuredPlayback& playback, player::Renderer& renderer) {
    player::Timeline& timeline = playback.timeline();
    warn_of_open_damage(session, timeline);
    STGS_ASSIGN(const auto cameras, find_cameras(timeline.metadata()));
    if (cameras.size() > 1) return usage_error("--play uses one camera, not {}", cameras.size());
    STGS_ASSIGN(const Played played,
                play(session, playback, renderer, views_of(cameras[0], timeline.metadata()), play_,
                     shown_file()));
    warn_of_damage(session, timeline);
    Json json = head(timeline, renderer, cameras, played.pass);
    json["play"] = to_json(played, play_);
    json["play"]["pipeline"] = pipeline_;
    json["play"]["eye_distance"] = eye_distance_ ? Json(*eye_distance_) : Json(nullptr);
    json["peak_memory"] = peak_memory();
    return session.emit(
        json, head_text(timeline, renderer, cameras, played.pass) + to_text(played, play_));
  }

  // Returns the fields that every benchmark reports.
  Json head(const player::Timeline& timeline, const player::Renderer& renderer,
            const std::vector<encoder::Camera>& cameras, const Pass& pass) const {
    Json sizes = Json::array();
    for (const encoder::Camera& camera : cameras) {
      sizes.push_back({{"width", camera.width}, {"height", camera.height}});
    }
    return {{"file", shown_file()},
            {"backend", renderer.name()},
            {"threads", concurrency()},
            {"animated", animate_},
            {"stored_ratio", std::max(stored_ratio_, 1)},
            {"full_sh", full_sh_},
            {"quality", quality_ ? Json(*quality_) : Json(nullptr)},
            {"file_bytes", timeline.reader().file_bytes()},
            {"primitives", timeline.reader().primitives()},
            {"damaged", damage_json(timeline)},
            {"stored", pass.stored},
            {"active", mean(pass.active)},
            {"rendered", mean(pass.splats)},
            {"fovea", fovea_radius_ ? Json(*fovea_radius_) : Json(nullptr)},
            {"cameras", sizes}};
  }

  static std::string head_text(const player::Timeline& timeline, const player::Renderer& renderer,
                               const std::vector<encoder::Camera>& cameras, const Pass& pass) {
    return fmt::format(
        "{} on {}, {}x{}{}: {} of {} primitives, {:.0f} active and {:.0f} rendered per frame\n",
        renderer.name(), plural(concurrency(), "thread"), cameras[0].width, cameras[0].height,
        cameras.size() > 1 ? " and others" : "", plural(std::ssize(pass.frame), "frame"),
        timeline.reader().primitives(), mean(pass.active), mean(pass.splats));
  }

  std::string file_, size_, pipeline_;
  std::vector<std::string> camera_files_;
  int num_frames_ = 40, stored_ratio_ = 0;
  bool animate_ = false, full_sh_ = false, steps_ = false;
  std::optional<double> eye_distance_, quality_;
  std::optional<std::uint64_t> seed_;
  std::optional<float> fovea_radius_;
  PlaySettings play_;
  std::string memory_ = "4G";
};

}  // namespace

std::unique_ptr<Command> make_bench() {
  return std::make_unique<Bench>();
}

}  // namespace stgs::tools
