// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <optional>

#include "bench_measure.h"
#include "bench_model.h"
#include "bench_play.h"
#include "camera_file.h"
#include "command.h"
#include "losses.h"
#include "options.h"
#include "place.h"
#include "stgs/format/parallel.h"
#include "stgs/player/renderer.h"
#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

// Of a picture's width: how far the axes of two eyes are off the middle, towards the nose.
constexpr float kNasalShift = 0.05f;

class Bench final : public Command {
 public:
  Help help() const override {
    return {
        "bench", "Measure how fast a .stgs file is drawn",
        "Draws pictures at moments spread evenly over the file, from the given cameras in\n"
        "turn, twice: the first pass decodes what it needs (fetch), the second finds it held,\n"
        "as far as --memory goes. frame: all of a picture, which stays on the device that\n"
        "drew it; slice: what is visible at the moment, projected; bin: into tiles, in order;\n"
        "blend: the pixels; device: these three by the clock of a GPU. Milliseconds a\n"
        "picture, over the pictures of a pass; fps is 1000 over the median.\n"
        "--stereo draws two eyes in one call and, in a third pass, the left one alone:\n"
        "with --fovea at full resolution and, in a fourth pass, as it is drawn for two.\n"
        "--steps draws each picture of the second pass once more, step by step, and tells\n"
        "beside the time of a step the least that its bytes or operations can take (cuda),\n"
        "or its bytes alone, as fast as the device copies them (vulkan).\n"
        "--play plays frames in order against a display's clock instead: through 'timeline'\n"
        "a moment is decoded when it is drawn, by the backend's device; through 'player' it\n"
        "is fetched and decoded ahead by the processor. A picture that is not ready when the\n"
        "next is due is missed.\n"
        "--animate gives each primitive of a model lifespans and speeds for comparing\n"
        "renderers: 300 frames, T uniform in them, sigma 3 frames for 30 % and 900 for the\n"
        "rest, r nearly 0, speeds to .001 units a frame and axis. --stored-ratio parts each into\n"
        "so many that follow each other: as many are alive, and so many times more stored.\n"
        "--full-sh gives a model of lower degree random ones up to degree 3. What\n"
        "is made so is held in memory as a file, lossless or of --quality.",
        "  stgs bench scene.stgs --size 3840x2160\n"
        "  stgs bench scene.stgs --size 2064x2208 --stereo 0.063 --fovea 500\n"
        "  stgs bench scene.stgs --play player --frames 300\n"
        "  stgs bench model.stgs --animate --camera a.json --camera b.json --format json"};
  }

  Shared shared() const override {
    return {.progress = true, .backend = "What draws", .threads = true};
  }
  void declare(CLI::App& app) override {
    app.add_option("FILE", file_, "The .stgs file, or its URL")->required();
    app.add_option("--camera", camera_files_,
                   "Camera file (JSON), as for render; may be given again. Else the file's own");
    app.add_option("--size", size_, "WIDTHxHEIGHT in pixels; the view angle is kept an axis each");
    auto* pictures = app.add_option("--num-frames", pictures_, "How many a pass draws");
    pictures->check(number_between(1, 1e6))->capture_default_str();
    app.add_option("--stereo", eye_distance_, "Draw two eyes so far apart, scene units")
        ->check(number_between(0, 1e6));
    app.add_option("--fovea", fovea_radius_,
                   "Full resolution so many pixels around a camera's axis alone, half beyond")
        ->check(number_between(0, 1e6));
    auto* steps = app.add_flag(
        "--steps", steps_, "Tell what each step of drawing takes, beside the least that it can");
    auto* play = app.add_option("--play", play_through_, "Play in order through this")
                     ->excludes(steps)
                     ->excludes(pictures)
                     ->check(CLI::IsMember({"timeline", "player"}));
    app.add_option("--frames", play_.frames, "How many --play plays")
        ->needs(play)
        ->check(number_between(1, 1e6))
        ->capture_default_str();
    app.add_option("--refresh", play_.refresh, "Pictures a second of --play")
        ->needs(play)
        ->check(number_between(1, 1e4))
        ->capture_default_str();
    app.add_option("--rate", play_.rate, "How fast --play plays; 1: as recorded")
        ->needs(play)
        ->check(number_between(0.01, 4))
        ->capture_default_str();
    auto* animate = app.add_flag("--animate", animate_,
                                 "Give the primitives lifespans and speeds of a comparison");
    app.add_option("--stored-ratio", lives_,
                   "Part each primitive into so many, one after the other")
        ->excludes(animate)
        ->check(number_between(1, 1000));
    app.add_flag("--full-sh", full_harmonics_,
                 "Give the primitives harmonics to degree 3, random where they have none");
    app.add_option("--quality", quality_,
                   "Pack what --animate, --stored-ratio or --full-sh made: 0 to 100, as convert")
        ->check(number_between(0, 100));
    app.add_option("--seed", seed_, "What is random in what they made: 1")
        ->check(check_whole_number);
    app.add_option("--memory", memory_mb_, "Decoded data held at most, MB (10^6 bytes)")
        ->check(number_between(1, 1e9))
        ->capture_default_str();
  }

  Status run(Session& session) override {
    STGS_ASSIGN(auto source, open(session));
    STGS_ASSIGN(auto renderer, player::make_renderer(session.options.backend));
    const auto budget = static_cast<std::uint64_t>(memory_mb_ * 1e6);
    if (play_through_ == "player") {
      STGS_ASSIGN(auto playback, playback_of(std::move(source), budget, play_.rate));
      return run_play(session, *playback, *renderer);
    }
    STGS_ASSIGN(auto reader, SceneReader::open(std::move(source)));
    auto timeline = player::Timeline::from_reader(std::move(reader), shown_file(), budget,
                                                  player::DamagePolicy::kSkip);
    if (play_through_ == "timeline") {
      const auto playback = playback_of(std::move(timeline), play_.rate);
      return run_play(session, *playback, *renderer);
    }
    return run_passes(session, *timeline, *renderer);
  }

 private:
  std::string shown_file() const { return player::display_location(file_); }

  Result<std::unique_ptr<ByteSource>> open(Session& session) const {
    if (!animate_ && !full_harmonics_ && lives_ == 0) {
      if (!quality_ && !seed_) return open_place(session, file_);
      return usage_error(
          "{} is of what --animate, --stored-ratio or --full-sh make; {} stays as it is",
          quality_ ? "--quality" : "--seed", shown_file());
    }
    STGS_ASSIGN(Scene scene, read_place(session, file_));
    const std::uint64_t most = ReadLimits{}.max_primitives;
    if (lives_ > 0 && scene.gaussians.size() > most / static_cast<std::uint64_t>(lives_)) {
      return usage_error(
          "--stored-ratio {} makes {} primitives of the {} of {}, more than the {} of a file",
          lives_, scene.gaussians.size() * static_cast<std::uint64_t>(lives_),
          scene.gaussians.size(), shown_file(), most);
    }
    const std::uint64_t seed = seed_.value_or(1);
    if (animate_) animate(scene, seed);
    if (full_harmonics_) fill_harmonics(scene.gaussians, seed + 1);
    if (interrupted()) return runtime_error("the model is not made");
    if (lives_ > 0) part_lives(scene, lives_, seed);
    WriteSettings settings;
    settings.zstd_level = 1;
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
        return usage_error("{}: has no start camera; give --camera", shown_file());
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

  // What a picture is drawn from: the camera, or two eyes beside it, the left one first.
  std::vector<player::View> views_of(const encoder::Camera& camera,
                                     const SceneMetadata& metadata) const {
    const float* b = metadata.background;
    const player::View view{camera.pinhole(metadata.near_plane), {b[0], b[1], b[2]}};
    std::vector<player::View> eyes(eye_distance_ ? 2 : 1, view);
    if (eye_distance_) part_eyes(eyes);
    for (player::View& eye : eyes) {
      if (fovea_radius_) eye.fovea = Fovea{{eye.camera.cx, eye.camera.cy}, *fovea_radius_};
    }
    return eyes;
  }

  void part_eyes(std::vector<player::View>& eyes) const {
    for (int eye = 0; eye < 2; ++eye) {
      math::PinholeCamera& pinhole = eyes[static_cast<std::size_t>(eye)].camera;
      const float side = eye == 0 ? 1.0f : -1.0f;
      pinhole.translation.x += side * 0.5f * static_cast<float>(*eye_distance_);
      pinhole.cx += side * kNasalShift * pinhole.width;
    }
  }

  struct Measured {
    // First, again; with --stereo one eye at full resolution, with --fovea too one as it is.
    std::vector<Pass> passes;
    StepTable steps;
  };

  Result<Measured> measure(Session& session, player::Timeline& timeline, player::Renderer& renderer,
                           const std::vector<encoder::Camera>& cameras) const {
    Measured out;
    out.passes.resize(!eye_distance_ ? 2 : fovea_radius_ ? 4 : 3);
    const auto pictures = static_cast<std::size_t>(pictures_), all = out.passes.size() * pictures;
    for (std::size_t k = 0; k < all; ++k) {
      const std::size_t pass = k / pictures, picture = k % pictures;
      std::vector<player::View> views =
          views_of(cameras[picture % cameras.size()], timeline.metadata());
      if (pass >= 2) views.resize(1);
      if (pass == 2) views[0].fovea.reset();
      const double seconds =
          timeline.duration_seconds() * (static_cast<double>(picture) + 0.5) / pictures_;
      player::RenderStats stats;
      const double begin = now_seconds();
      STGS_TRY(at_moment(renderer.draw(timeline, seconds, views, &stats), shown_file(), seconds));
      out.passes[pass].add(1e3 * (now_seconds() - begin), stats);
      // A backend that cannot tell says so before the first pass has been waited for.
      if (steps_ && k == 0) STGS_TRY(renderer.profile().status());
      if (steps_ && pass == 1) {
        STGS_ASSIGN(const player::RenderProfile profile, renderer.profile());
        out.steps.add(profile);
      }
      if (!session.progress("bench", k + 1, all)) {
        return runtime_error("the measurement is not complete");
      }
    }
    return out;
  }

  Status run_passes(Session& session, player::Timeline& timeline, player::Renderer& renderer) {
    tell_damage(session, timeline);
    STGS_ASSIGN(const auto cameras, find_cameras(timeline.metadata()));
    STGS_ASSIGN(const Measured measured, measure(session, timeline, renderer, cameras));
    tell_losses(session, timeline);
    const Pass &first = measured.passes[0], &again = measured.passes[1];
    Json json = head(timeline, renderer, cameras, again);
    json["num_frames"] = pictures_;
    json["cold"] = to_json(first);
    json["warm"] = to_json(again);
    std::string text = head_text(timeline, renderer, cameras, again) + to_text("cold", first) +
                       to_text("warm", again);
    if (eye_distance_) {
      const Pass& one = measured.passes[2];
      const double times = percentile(again.frame, 0.5) / percentile(one.frame, 0.5);
      json["stereo"] = {
          {"eye_distance", *eye_distance_}, {"one_eye", to_json(one)}, {"ratio_to_one_eye", times}};
      text += to_text("one eye", one) + fmt::format("two eyes take {:.3f} times as long{}\n", times,
                                                    fovea_radius_ ? " as one without a fovea" : "");
      if (fovea_radius_) {
        const Pass& alike = measured.passes[3];
        json["stereo"]["one_eye_foveated"] = to_json(alike);
        const double times_alike = percentile(again.frame, 0.5) / percentile(alike.frame, 0.5);
        json["stereo"]["ratio_to_one_eye_foveated"] = times_alike;
        text += to_text("one alike", alike) +
                fmt::format("two eyes take {:.3f} times as long as one alike\n", times_alike);
      }
    }
    if (steps_) {
      json["steps"] = measured.steps.to_json();
      text += measured.steps.to_text();
    }
    json["peak_memory"] = peak_memory();
    text += fmt::format("{:.1f} pictures a second, peak memory {}\n",
                        1e3 / percentile(again.frame, 0.5), human_bytes(peak_memory()));
    return session.emit(json, text);
  }

  Status run_play(Session& session, MeasuredPlayback& playback, player::Renderer& renderer) {
    player::Timeline& timeline = playback.timeline();
    tell_damage(session, timeline);
    STGS_ASSIGN(const auto cameras, find_cameras(timeline.metadata()));
    if (cameras.size() > 1) return usage_error("--play takes one camera, not {}", cameras.size());
    STGS_ASSIGN(const Played played,
                play(session, playback, renderer, views_of(cameras[0], timeline.metadata()), play_,
                     shown_file()));
    tell_losses(session, timeline);
    Json json = head(timeline, renderer, cameras, played.pass);
    json["play"] = to_json(played, play_);
    json["play"]["pipeline"] = play_through_;
    json["play"]["eye_distance"] = eye_distance_ ? Json(*eye_distance_) : Json(nullptr);
    json["peak_memory"] = peak_memory();
    return session.emit(
        json, head_text(timeline, renderer, cameras, played.pass) + to_text(played, play_));
  }

  // What is told whatever was measured.
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
            {"stored_ratio", std::max(lives_, 1)},
            {"full_sh", full_harmonics_},
            {"quality", quality_ ? Json(*quality_) : Json(nullptr)},
            {"file_bytes", timeline.reader().file_bytes()},
            {"primitives", timeline.reader().primitives()},
            {"damaged", losses_json(timeline)},
            {"stored", pass.stored},
            {"active", mean(pass.alive)},
            {"rendered", mean(pass.drawn)},
            {"fovea", fovea_radius_ ? Json(*fovea_radius_) : Json(nullptr)},
            {"cameras", sizes}};
  }

  static std::string head_text(const player::Timeline& timeline, const player::Renderer& renderer,
                               const std::vector<encoder::Camera>& cameras, const Pass& pass) {
    return fmt::format(
        "{} on {} threads, {}x{}{}: {} pictures of {} primitives, {:.0f} alive and {:.0f} drawn at "
        "a moment\n",
        renderer.name(), concurrency(), cameras[0].width, cameras[0].height,
        cameras.size() > 1 ? " and others" : "", pass.frame.size(), timeline.reader().primitives(),
        mean(pass.alive), mean(pass.drawn));
  }

  std::string file_, size_, play_through_;
  std::vector<std::string> camera_files_;
  int pictures_ = 40, lives_ = 0;
  bool animate_ = false, full_harmonics_ = false, steps_ = false;
  std::optional<double> eye_distance_, quality_;
  std::optional<std::uint64_t> seed_;
  std::optional<float> fovea_radius_;
  PlaySettings play_;
  double memory_mb_ = 4096;
};

}  // namespace

std::unique_ptr<Command> make_bench() {
  return std::make_unique<Bench>();
}

}  // namespace stgs::tools
