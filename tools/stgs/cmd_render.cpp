// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <cmath>
#include <filesystem>
#include <limits>

#include "camera_file.h"
#include "command.h"
#include "losses.h"
#include "options.h"
#include "picture_sink.h"
#include "place.h"
#include "stgs/encoder/windows.h"
#include "stgs/player/renderer.h"
#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

constexpr double kFrameTolerance = 1e-6;  // ticks; how near a moment must be to a captured frame

struct Moment {
  double seconds = 0;
  double ticks = 0;
};

struct Options {
  std::string file, camera, cameras, which = "test", frames, size, background, output;
  double time = 0;
  double memory_mb = 4096;
  bool beside = false;
};

class Render final : public Command {
 public:
  Help help() const override {
    return {
        "render", "Draw pictures or video from a .stgs file",
        "Draws from the file's start camera, from a camera file, or from the cameras of a\n"
        "prepared capture, at one moment or for a range of frames. The output's ending chooses\n"
        "what is written: .png (8 bits), .exr (linear RGB and A as half floats, depth Z as\n"
        "float), .mp4 (H.264), .y4m (4:4:4, 8 bits, BT.709 limited range; - for standard\n"
        "output), a folder (ends with /: a PNG a frame, one folder a camera), or null (draws\n"
        "and measures only).\n"
        "A camera file is JSON: {\"width\", \"height\", \"fx\", \"fy\", \"cx\", \"cy\" in "
        "pixels,\n"
        "\"rotation\": 9 numbers row by row and \"translation\": 3, world to camera, x right,\n"
        "y down, z forward}; an entry of capture.json's cameras and the output of\n"
        "'stgs info --format json' are such files.",
        "  stgs render scene.stgs --time 0.5 -o picture.png\n"
        "  stgs render scene.stgs --cameras prepared/ --which test --frames 0:20 --side-by-side"
        " -o both.mp4\n"
        "  stgs render scene.stgs --frames 0: --size 1280x720 -o - | ffplay -"};
  }

  Shared shared() const override {
    return {.progress = true, .log_level = true, .backend = "What draws", .threads = true};
  }
  void declare(CLI::App& app) override {
    app.add_option("FILE", o_.file, "The .stgs file, or its URL")->required();
    auto* camera = app.add_option("--camera", o_.camera, "Camera file (JSON); see below");
    auto* cameras =
        app.add_option("--cameras", o_.cameras, "Prepared capture whose cameras are used")
            ->excludes(camera);
    app.add_option("--which", o_.which, "Of --cameras: test, train, all, or names with commas")
        ->capture_default_str()
        ->needs(cameras);
    auto* time =
        app.add_option("--time", o_.time, "Moment in seconds")->check(number_between(-1e9, 1e9));
    time_ = time;
    app.add_option("--frames", o_.frames, "Frames FIRST:END, END not included; 0: is all of them")
        ->excludes(time);
    app.add_option("--size", o_.size,
                   "WIDTHxHEIGHT in pixels; the view angle is kept an axis each");
    app.add_option("--background", o_.background, "r,g,b from 0 to 1; else the file's");
    app.add_flag("--side-by-side", o_.beside,
                 "Draw the capture's own frame to the right of the render")
        ->needs(cameras);
    app.add_option("--memory", o_.memory_mb, "Decoded data held at most, MB (10^6 bytes)")
        ->check(number_between(1, 1e9))
        ->capture_default_str();
    app.add_option("-o,--output", o_.output, "FILE.png, .exr, .mp4, .y4m, FOLDER/, - or null")
        ->required();
  }

  Status run(Session& session) override {
    STGS_ASSIGN(auto reader, open_scene(session, o_.file));
    const auto timeline = player::Timeline::from_reader(
        std::move(reader), shown_file(), static_cast<std::uint64_t>(o_.memory_mb * 1e6),
        player::DamagePolicy::kSkip);
    tell_damage(session, *timeline);
    STGS_ASSIGN(auto renderer, player::make_renderer(session.options.backend));
    STGS_ASSIGN(const auto cameras, find_cameras(timeline->metadata()));
    STGS_ASSIGN(const auto moments, find_moments(*timeline));
    player::View view;
    STGS_TRY(find_background(timeline->metadata(), view));
    STGS_ASSIGN(auto sink, make_picture_sink(o_.output, timeline->metadata().time_base,
                                             cameras.size(), moments.size(), session.log_sink()));
    if (o_.beside && !sink->wants_8bit()) {
      return usage_error(
          "--side-by-side draws two pictures into one: choose .png, .mp4, .y4m or a folder");
    }
    Totals totals;
    const double begin = now_seconds();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
      view.camera = cameras[c].pinhole(timeline->metadata().near_plane);
      for (std::size_t m = 0; m < moments.size(); ++m) {
        const Status drawn =
            draw(*renderer, *timeline, cameras[c], moments[m], view, *sink, totals);
        if (drawn.code() == StatusCode::kNoMemory) {  // a file's camera may have any size
          return {StatusCode::kNoMemory,
                  fmt::format("{}; {}x{} pixels are drawn, --size takes fewer", drawn.message(),
                              cameras[c].width, cameras[c].height)};
        }
        STGS_TRY(drawn);
        if (!session.progress("render", c * moments.size() + m + 1,
                              cameras.size() * moments.size())) {
          return runtime_error("nothing is written");
        }
      }
    }
    STGS_TRY(sink->finish());
    totals.wall = now_seconds() - begin;
    tell_losses(session, *timeline);
    return report(session, *timeline, cameras, moments, renderer->name(), totals);
  }

 private:
  std::string shown_file() const { return player::display_location(o_.file); }

  struct Totals {
    player::RenderStats stats;
    double draw = 0, wall = 0;  // seconds
  };

  Result<std::vector<encoder::Camera>> find_cameras(const SceneMetadata& metadata) {
    std::vector<encoder::Camera> cameras;
    if (!o_.cameras.empty()) {
      STGS_ASSIGN(capture_, encoder::read_prepared_capture(o_.cameras));
      if (o_.beside) {
        STGS_ASSIGN(capture_, encoder::capture_for_scene(capture_, metadata, shown_file()));
      }
      STGS_ASSIGN(cameras, choose_cameras(capture_, o_.which));
    } else if (!o_.camera.empty()) {
      STGS_ASSIGN(const encoder::Camera camera, read_camera(o_.camera));
      cameras = {camera};
    } else if (metadata.start_camera) {
      STGS_ASSIGN(const encoder::Camera camera, camera_of(*metadata.start_camera, shown_file()));
      cameras = {camera};
    } else {
      return usage_error("{}: has no start camera; give --camera or --cameras", shown_file());
    }
    if (!o_.size.empty()) {
      STGS_ASSIGN(const Size size, parse_size(o_.size));
      for (auto& camera : cameras) camera = resized(camera, size);
    }
    return cameras;
  }

  Result<std::vector<Moment>> find_moments(const player::Timeline& timeline) const {
    const TimeBase base = timeline.metadata().time_base;
    constexpr std::uint32_t kMostFrames = std::numeric_limits<int>::max();
    const std::uint32_t total = timeline.metadata().frames;
    if (total > kMostFrames) {
      return unsupported("{}: has {} frames; more than {} cannot be drawn here", shown_file(),
                         total, kMostFrames);
    }
    std::vector<Moment> moments;
    if (time_->count() > 0) {
      if (o_.time < 0 || o_.time > timeline.duration_seconds()) {
        return usage_error("--time {} is out of range: {} lasts from 0 to {:.6g} s", o_.time,
                           shown_file(), timeline.duration_seconds());
      }
      moments.push_back({o_.time, base.ticks(o_.time)});
    } else if (!o_.frames.empty()) {
      STGS_ASSIGN(const FrameRange range, parse_frames(o_.frames, static_cast<int>(total)));
      for (int i = range.begin; i < range.end; ++i) moments.push_back({base.seconds(i), 1.0 * i});
    } else {
      return usage_error("say when: --time SECONDS or --frames FIRST:END");
    }
    return moments;
  }

  Status find_background(const SceneMetadata& metadata, player::View& view) const {
    const float* b = metadata.background;
    view.background = {b[0], b[1], b[2]};
    if (o_.background.empty()) return {};
    STGS_ASSIGN(const auto colour, parse_colour(o_.background));
    view.background = {colour[0], colour[1], colour[2]};
    return {};
  }

  Status draw(player::Renderer& renderer, player::Timeline& timeline, const encoder::Camera& camera,
              const Moment& moment, const player::View& view, PictureSink& sink, Totals& totals) {
    player::RenderStats stats;
    const double begin = now_seconds();
    STGS_TRY(at_moment(renderer.render(timeline, moment.seconds, {view}, frames_, &stats),
                       shown_file(), moment.seconds));
    totals.draw += now_seconds() - begin;
    totals.stats.splats += stats.splats;
    totals.stats.fetch_ms += stats.fetch_ms;
    totals.stats.slice_ms += stats.slice_ms;
    totals.stats.bin_ms += stats.bin_ms;
    totals.stats.blend_ms += stats.blend_ms;
    // A camera of the file or of --camera has no folder of its own.
    const PictureName name{o_.cameras.empty() ? "" : camera.name,
                           static_cast<int>(std::lround(moment.ticks))};
    if (!sink.wants_8bit()) return sink.add(name, frames_[0]);
    encoder::Image8 picture = to_8bit(frames_[0].colour);
    if (o_.beside) {
      const double frame = std::round(moment.ticks);
      if (std::abs(frame - moment.ticks) > kFrameTolerance || frame >= capture_.frames) {
        return usage_error("--side-by-side needs a moment that {} has a frame of; {} s is none",
                           o_.cameras, moment.seconds);
      }
      STGS_ASSIGN(const encoder::Image8 truth, load_truth(camera.name, static_cast<int>(frame)));
      picture = side_by_side(picture, truth);
    }
    return sink.add(name, picture);
  }

  Result<encoder::Image8> load_truth(const std::string& name, int frame) const {
    for (const encoder::Camera& camera : capture_.cameras) {
      if (camera.name == name) return encoder::load_frame(capture_, camera, frame);
    }
    return runtime_error("{}: has no camera '{}'", o_.cameras, name);
  }

  Status report(Session& session, const player::Timeline& timeline,
                const std::vector<encoder::Camera>& cameras, const std::vector<Moment>& moments,
                const std::string& backend, const Totals& totals) const {
    const std::size_t pictures = cameras.size() * moments.size();
    const auto n = static_cast<double>(pictures);
    const double fps = totals.draw > 0 ? n / totals.draw : 0;
    Json names = Json::array();
    for (const auto& camera : cameras) {
      names.push_back({{"name", camera.name}, {"width", camera.width}, {"height", camera.height}});
    }
    const Json json = {{"output", o_.output},
                       {"backend", backend},
                       {"images", pictures},
                       {"cameras", names},
                       {"damaged", losses_json(timeline)},
                       {"render_s", totals.draw},
                       {"wall_s", totals.wall},
                       {"render_fps", fps},
                       {"mean_ms",
                        {{"fetch", totals.stats.fetch_ms / n},
                         {"slice", totals.stats.slice_ms / n},
                         {"bin", totals.stats.bin_ms / n},
                         {"blend", totals.stats.blend_ms / n}}},
                       {"mean_splats", static_cast<double>(totals.stats.splats) / n},
                       {"peak_memory", peak_memory()}};
    const std::string text =
        fmt::format("{}: {} picture(s), {:.1f} ms to draw each ({:.1f} a second), peak memory {}\n",
                    o_.output, pictures, 1000 * totals.draw / n, fps, human_bytes(peak_memory()));
    if (o_.output != "-") return session.emit(json, text);
    session.emit_aside(json, text);
    return {};
  }

  Options o_;
  CLI::Option* time_ = nullptr;
  encoder::PreparedCapture capture_;
  std::vector<player::Frame> frames_;
};

}  // namespace

std::unique_ptr<Command> make_render() {
  return std::make_unique<Render>();
}

}  // namespace stgs::tools
