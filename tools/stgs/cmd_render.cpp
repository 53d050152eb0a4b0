// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "allow_outside.h"
#include "camera_file.h"
#include "command.h"
#include "end_after_signal.h"
#include "image_sink.h"
#include "options.h"
#include "printable.h"
#include "scene_capture.h"
#include "scene_file.h"
#include "scene_renderer.h"

namespace stgs::tools {
namespace {

constexpr double kFrameTolerance = 1e-6;  // ticks; distance of a time from a captured frame

struct RenderTime {
  double seconds = 0;
  double ticks = 0;
};

// One time, or those of a range of frames, which may have any length.
struct RenderTimes {
  TimeBase base;
  FrameRange frames;
  std::optional<RenderTime> single;

  std::size_t size() const {
    return single ? 1 : static_cast<std::size_t>(frames.end - frames.begin);
  }
  RenderTime at(std::size_t i) const {
    if (single) return *single;
    const std::int64_t frame = frames.begin + static_cast<std::int64_t>(i);
    return {base.seconds(static_cast<double>(frame)), static_cast<double>(frame)};
  }
};

struct Options {
  bool allow_outside = false;
  std::string file, camera, cameras, which = "test", frames, size, background, output;
  double time = 0;
  std::string memory = "4G";
  bool side_by_side = false, stretch = false;
};

class Render final : public Command {
 public:
  Help help() const override {
    return {
        "render", "Render images or video from a .stgs file",
        "Renders from the start camera of the file, from a camera file, or from the cameras of a\n"
        "prepared capture, at one time or for a range of frames. The name of the output selects\n"
        "the format: .png (8 bits), .exr (linear RGB and A as half floats, depth Z as float),\n"
        ".mp4 (H.264), .y4m (4:4:4, 8 bits, BT.709 limited range; - for standard output), a\n"
        "folder (ends with /: one PNG per frame, one subfolder per camera), or null (no output,\n"
        "to measure only).\n"
        "A camera file is JSON: {\"width\", \"height\", \"fx\", \"fy\", \"cx\", \"cy\" in pixels,\n"
        "\"rotation\": 9 numbers, row-major, and \"translation\": 3, world to camera, x right, y\n"
        "down, z forward}. An entry of \"cameras\" in capture.json and the output of\n"
        "'stgs info --format json' are camera files.",
        "  stgs render scene.stgs --time 0.5 -o image.png\n"
        "  stgs render scene.stgs --cameras prepared/ --which test --frames 0:20 --side-by-side"
        " -o both.mp4\n"
        "  stgs render scene.stgs --frames 0: --size 1280x720 -o - | ffplay -"};
  }

  Shared shared() const override {
    return {
        .progress = true, .log_level = true, .backend = "Renderer", .threads = true, .urls = true};
  }
  void declare(Arguments& app) override {
    app.add_option("FILE", o_.file, "The .stgs file: a path, a URL, or - for standard input")
        ->required();
    auto* camera = app.add_option("--camera", o_.camera, "Camera file (JSON), described below");
    auto* cameras =
        app.add_option("--cameras", o_.cameras, "Use the cameras of this prepared capture")
            ->excludes(camera);
    add_allow_outside(app, o_.allow_outside)->needs(cameras);
    app.add_option("--which", o_.which,
                   "Cameras of --cameras: test, train, all, or comma-separated names")
        ->capture_default_str()
        ->needs(cameras);
    auto* time =
        app.add_option("--time", o_.time, "Time in seconds")->check(number_between(-1e9, 1e9));
    time_ = time;
    app.add_option("--frames", o_.frames, "Frames FIRST:END, END excluded; 0: selects all")
        ->check(accepted_by<parse_open_frames>)
        ->excludes(time);
    auto* size =
        app.add_option("--size", o_.size,
                       "Image size WIDTHxHEIGHT in pixels; another aspect ratio shows more of the "
                       "scene along one axis")
            ->check(accepted_by<parse_size>);
    app.add_flag("--stretch", o_.stretch,
                 "Stretch the image to --size: keep the field of view of each axis")
        ->needs(size);
    app.add_option("--background", o_.background,
                   "Background colour r,g,b, each 0 to 1 (default: from the file)")
        ->check(accepted_by<parse_colour>);
    app.add_flag("--side-by-side", o_.side_by_side,
                 "Place the captured frame to the right of the render")
        ->needs(cameras);
    app.add_option("--memory", o_.memory, "Memory for decoded data, for example 512M or 8G")
        ->check(accepted_by<parse_memory>)
        ->capture_default_str();
    app.add_option("-o,--output", o_.output,
                   "Output: FILE.png, .exr, .mp4, .y4m, FOLDER/, - or null")
        ->required();
  }

  Status run(Session& session) override {
    STGS_ASSIGN(const std::uint64_t memory, parse_memory(o_.memory));
    STGS_ASSIGN(file_, SceneFile::open(session, o_.file, memory));
    STGS_TRY(file_->warn_of_open_damage());
    STGS_ASSIGN(const auto renderer, SceneRenderer::make(session.options.backend));
    info_ = sized<stgs_scene_info>();
    STGS_TRY(file_->check(stgs_scene_get_info(file_->get(), &info_)));
    STGS_ASSIGN(const auto cameras, find_cameras());
    STGS_ASSIGN(const RenderTimes times, find_times());
    STGS_ASSIGN(const stgs_view view, make_view());
    STGS_ASSIGN(auto sink,
                make_image_sink(o_.output, time_base(), cameras.size(), times.size(), session));
    if (o_.side_by_side && !sink->wants_8bit()) {
      return usage_error(
          "--side-by-side writes 8-bit images; use a .png, .mp4, .y4m or folder output");
    }
    const EndAfterSignal end(session, o_.output + ": not written");
    Totals totals;
    const double begin = now_seconds();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
      for (std::size_t m = 0; m < times.size(); ++m) {
        const Status rendered = render(*renderer, cameras[c], times.at(m), view, *sink, totals);
        if (rendered.code() == StatusCode::kNoMemory) {  // a camera file may have any size
          return {StatusCode::kNoMemory,
                  fmt::format("{}; the image has {}x{} pixels, reduce it with --size",
                              rendered.message(), cameras[c].width, cameras[c].height)};
        }
        STGS_TRY(rendered);
        if (!session.progress("render", c * times.size() + m + 1, cameras.size() * times.size())) {
          return runtime_error("{}: not written", o_.output);
        }
      }
    }
    STGS_TRY(sink->finish());
    totals.wall = now_seconds() - begin;
    STGS_ASSIGN(const DamageCount damage, file_->count_damage());
    warn_of_damage(session, file_->name(), damage);
    return report(session, damage, cameras, times, renderer->backend(), totals);
  }

 private:
  // Sums over all images.
  struct Totals {
    stgs_render_statistics steps{};
    double render = 0, wall = 0;  // seconds
  };

  const std::string& shown_file() const { return file_->name(); }
  TimeBase time_base() const { return {info_.time_base_numerator, info_.time_base_denominator}; }

  Result<std::vector<encoder::Camera>> find_cameras() {
    std::vector<encoder::Camera> cameras;
    if (!o_.cameras.empty()) {
      STGS_ASSIGN(capture_, encoder::read_prepared_capture(o_.cameras, o_.allow_outside));
      if (o_.side_by_side) {
        STGS_ASSIGN(capture_, capture_of_scene(capture_, *file_));
      }
      STGS_ASSIGN(cameras, choose_cameras(capture_, o_.which));
    } else if (!o_.camera.empty()) {
      STGS_ASSIGN(const encoder::Camera camera, read_camera(o_.camera));
      cameras = {camera};
    } else if (info_.has_start_camera != 0) {
      auto start = sized<stgs_view>();
      STGS_TRY(file_->check(stgs_scene_start_view(file_->get(), &start)));
      STGS_ASSIGN(const encoder::Camera camera, camera_of(start, shown_file()));
      cameras = {camera};
    } else {
      return usage_error("{}: no start camera; use --camera or --cameras", shown_file());
    }
    if (!o_.size.empty()) {
      STGS_ASSIGN(const Size size, parse_size(o_.size));
      for (auto& camera : cameras) {
        camera = o_.stretch ? resized(camera, size) : fitted(camera, size);
      }
    }
    return cameras;
  }

  Result<RenderTimes> find_times() const {
    const TimeBase base = time_base();
    constexpr std::uint32_t kMaxFrames = std::numeric_limits<int>::max();
    const std::uint32_t total = info_.frames;
    if (total > kMaxFrames) {
      return unsupported("{}: has {} frames; at most {} are supported", shown_file(), total,
                         kMaxFrames);
    }
    RenderTimes times{.base = base, .frames = {}, .single = {}};
    if (time_->count() > 0) {
      if (o_.time < 0 || o_.time > info_.duration_seconds) {
        return usage_error("--time {} is out of range; {} lasts from 0 to {:.6g} s", o_.time,
                           shown_file(), info_.duration_seconds);
      }
      times.single = {o_.time, base.ticks(o_.time)};
    } else if (!o_.frames.empty()) {
      STGS_ASSIGN(times.frames, parse_frames(o_.frames, static_cast<int>(total)));
    } else {
      return usage_error("no time is given; use --time SECONDS or --frames FIRST:END");
    }
    return times;
  }

  // Returns the view without its camera.
  Result<stgs_view> make_view() const {
    stgs_view view;
    STGS_TRY(file_->check(stgs_view_defaults(&view, sizeof(view))));
    if (info_.near_plane > 0) view.near_plane = info_.near_plane;
    std::copy_n(info_.background, 3, view.background);
    if (o_.background.empty()) return view;
    STGS_ASSIGN(const auto colour, parse_colour(o_.background));
    std::copy_n(colour.begin(), 3, view.background);
    return view;
  }

  // Returns the time to render at: next to ground truth, that at which the camera took it.
  Result<double> seconds_of(const encoder::Camera& camera, const RenderTime& time) const {
    if (!o_.side_by_side) return time.seconds;
    const double index = std::round(time.ticks);
    if (std::abs(index - time.ticks) > kFrameTolerance || index >= capture_.frames) {
      return usage_error("--side-by-side needs the time of a frame; {} has none at {} s",
                         o_.cameras, time.seconds);
    }
    const double ticks = capture_.time_of(camera, static_cast<int>(index));
    return time_base().seconds(std::clamp(ticks, 0.0, static_cast<double>(info_.frames)));
  }

  Status render(SceneRenderer& renderer, const encoder::Camera& camera, const RenderTime& time,
                const stgs_view& base, ImageSink& sink, Totals& totals) {
    const stgs_view view = view_of(camera, base);
    STGS_ASSIGN(const double seconds, seconds_of(camera, time));
    encoder::Image8 image;
    FloatFrame frame;
    const double begin = now_seconds();
    if (sink.wants_8bit()) {
      Result<encoder::Image8> rendered = renderer.render_8bit(*file_, seconds, view);
      STGS_TRY(with_render_time(rendered.status(), shown_file(), seconds));
      image = std::move(rendered).value();
    } else {
      Result<FloatFrame> rendered = renderer.render_float(*file_, seconds, view);
      STGS_TRY(with_render_time(rendered.status(), shown_file(), seconds));
      frame = std::move(rendered).value();
    }
    totals.render += now_seconds() - begin;
    STGS_ASSIGN(const stgs_render_statistics steps, renderer.statistics());
    totals.steps.splats += steps.splats;
    totals.steps.fetch_ms += steps.fetch_ms;
    totals.steps.slice_ms += steps.slice_ms;
    totals.steps.bin_ms += steps.bin_ms;
    totals.steps.blend_ms += steps.blend_ms;
    // The camera of the file or of --camera has no subfolder.
    const ImageName name{o_.cameras.empty() ? "" : camera.name,
                         static_cast<int>(std::lround(time.ticks))};
    if (!sink.wants_8bit()) return sink.add(name, frame);
    if (o_.side_by_side) {
      STGS_ASSIGN(const encoder::Image8 ground_truth, load_ground_truth(camera.name, name.frame));
      STGS_ASSIGN(image, side_by_side(image, ground_truth,
                                      fmt::format("{}: camera '{}'", o_.cameras, camera.name),
                                      image_memory(*file_)));
    }
    return sink.add(name, image);
  }

  Result<encoder::Image8> load_ground_truth(const std::string& name, int frame) const {
    for (const encoder::Camera& camera : capture_.cameras) {
      if (camera.name == name) return encoder::load_frame(capture_, camera, frame);
    }
    return runtime_error("{}: no camera '{}'", o_.cameras, name);
  }

  Status report(Session& session, const DamageCount& damage,
                const std::vector<encoder::Camera>& cameras, const RenderTimes& times,
                const std::string& backend, const Totals& totals) const {
    const std::size_t images = cameras.size() * times.size();
    const auto n = static_cast<double>(images);
    const double fps = totals.render > 0 ? n / totals.render : 0;
    Json names = Json::array();
    for (const auto& camera : cameras) {
      names.push_back({{"name", camera.name}, {"width", camera.width}, {"height", camera.height}});
    }
    const Json json = {{"output", o_.output},
                       {"backend", backend},
                       {"images", images},
                       {"cameras", names},
                       {"damaged", damage_json(damage)},
                       {"render_s", totals.render},
                       {"wall_s", totals.wall},
                       {"render_fps", fps},
                       {"mean_ms",
                        {{"fetch", totals.steps.fetch_ms / n},
                         {"slice", totals.steps.slice_ms / n},
                         {"bin", totals.steps.bin_ms / n},
                         {"blend", totals.steps.blend_ms / n}}},
                       {"mean_splats", static_cast<double>(totals.steps.splats) / n},
                       {"peak_memory", peak_memory()}};
    const std::string text = fmt::format(
        "{}: {}, {:.1f} ms per image ({:.1f} fps), peak memory {}\n", one_line(o_.output),
        plural(images, "image"), 1000 * totals.render / n, fps, human_bytes(peak_memory()));
    if (o_.output != "-") return session.emit(json, text);
    session.emit_to_stderr(json, text);
    return {};
  }

  Options o_;
  Argument* time_ = nullptr;
  std::unique_ptr<SceneFile> file_;
  stgs_scene_info info_{};
  encoder::PreparedCapture capture_;
};

}  // namespace

std::unique_ptr<Command> make_render() {
  return std::make_unique<Render>();
}

}  // namespace stgs::tools
