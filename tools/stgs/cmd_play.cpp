// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "camera_file.h"
#include "command.h"
#include "location.h"
#include "options.h"
#include "printable.h"
#include "scene_file.h"
#include "standard_streams.h"
#ifdef STGS_HAS_PLAY
#include "play/viewer.h"
#endif

namespace stgs::tools {
namespace {

class Play final : public Command {
 public:
  Help help() const override {
    return {
        "play", "Play a .stgs file in a window, from any viewpoint",
        "Renders with Vulkan while the file loads, from a disk or from a server that supports\n"
        "byte ranges.\n"
        "Mouse: left drag orbits around the scene, right drag looks around, middle drag pans, the\n"
        "wheel zooms. The bar at the bottom shows the buffered part and seeks.\n"
        "Keys: space pause, left and right one frame (with shift one second), up and down speed,\n"
        "home and end, L loop, W A S D E Q fly (shift: faster), R reset the camera, F1 hide the\n"
        "overlay, P or F12 save a screenshot (stgs-001.png and so on), escape close.",
        "  stgs play scene.stgs --loop\n"
        "  stgs play https://example.org/scene.stgs --size 1920x1080\n"
        "  stgs play scene.stgs --time 0.5 --paused --screenshot window.png"};
  }

  Shared shared() const override { return {.log_level = true, .threads = true, .urls = true}; }

  void declare(Arguments& app) override {
    app.add_option("FILE", file_, "The .stgs file, or its URL")->required();
    app.add_option("--start-camera,--camera", camera_,
                   "Camera file (JSON), as for render (default: the start camera of the file)");
    app.add_option("--size", size_,
                   "Window size WIDTHxHEIGHT (default: of the camera, at most 1280x720)")
        ->check(accepted_by<parse_size>);
    app.add_option("--time", time_,
                   "Start time, seconds; 0: the beginning, or the live edge of a growing recording")
        ->check(number_between(0, 1e9))
        ->capture_default_str();
    app.add_option("--rate", rate_, "Playback rate, -2 to 4, not 0")
        ->check(number_between(-2, 4))
        ->capture_default_str();
    app.add_flag("--loop", loop_, "Repeat");
    app.add_flag("--paused", paused_, "Start paused");
    app.add_flag("--no-overlay", no_overlay_, "Hide the overlay (F1 shows it)");
    app.add_option("--memory", memory_,
                   "Memory for fetched and decoded data, for example 512M or 8G")
        ->check(accepted_by<parse_memory>)
        ->capture_default_str();
    auto* screenshot = app.add_option(
        "--screenshot", screenshot_,
        "Write the window to this .png once all layers and the statistics are available, and exit; "
        "playback continues until then unless --paused is given. Exit code 4 if data is missing");
    app.add_option("--after", after_, "Take the --screenshot no earlier than this frame")
        ->check(number_between(1, 1e9))
        ->capture_default_str()
        ->needs(screenshot);
  }

  Status run(Session& session) override {
    if (is_standard_input(file_)) {
      return usage_error("play cannot read standard input; write the data to a file first");
    }
    if (rate_ == 0) return usage_error("--rate 0 is not supported; use --paused");
    if (!screenshot_.empty() && extension_is_not_png()) {
      return usage_error("--screenshot {}: screenshots are PNG files; use a name that ends in .png",
                         screenshot_);
    }
    std::optional<Size> size;
    if (!size_.empty()) {
      STGS_ASSIGN(size, parse_size(size_));
    }
    std::optional<encoder::Camera> camera;
    if (!camera_.empty()) {
      STGS_ASSIGN(camera, read_camera(camera_));
    }
#ifdef STGS_HAS_PLAY
    ViewerSettings settings;
    settings.playback.file = file_;
    settings.playback.seconds = time_;
    settings.playback.rate = rate_;
    settings.playback.paused = paused_;
    settings.playback.loop = loop_;
    STGS_ASSIGN(settings.playback.memory, parse_memory(memory_));
    settings.camera = camera;
    settings.size = size;
    settings.overlay = !no_overlay_;
    settings.screenshot = screenshot_;
    settings.after = after_;
    STGS_ASSIGN(const ViewerReport report, run_viewer(session, settings));
    return print(session, report);
#else
    (void)session;
    return not_built(
        "'play' is not part of this build: it needs GLFW, Dear ImGui and Vulkan (Debian: "
        "libglfw3-dev, libimgui-dev, libvulkan-dev, libvulkan-volk-dev, glslc); use 'stgs render'");
#endif
  }

 private:
  bool extension_is_not_png() const {
    constexpr std::string_view kEnding = ".png";
    return screenshot_.size() < kEnding.size() ||
           screenshot_.compare(screenshot_.size() - kEnding.size(), kEnding.size(), kEnding) != 0;
  }

#ifdef STGS_HAS_PLAY
  Status print(Session& session, const ViewerReport& report) const {
    const double fps =
        report.busy_seconds > 0 ? static_cast<double>(report.busy_frames) / report.busy_seconds : 0;
    Json json = {{"file", display_name(file_)},
                 {"device", report.device},
                 {"width", report.size.width},
                 {"height", report.size.height},
                 {"frames_shown", report.frames},
                 {"fps", fps},
                 {"stalls", report.stalls},
                 {"seconds", report.seconds},
                 {"camera", nullptr},
                 {"screenshot", nullptr},
                 { "peak_memory", peak_memory() }};
    if (report.frames > 0) json["camera"] = camera_json(report.camera);
    if (!screenshot_.empty()) json["screenshot"] = screenshot_;
    const std::string text = fmt::format(
        "{} on {}: {} of {}x{} ({:.1f} fps), {}, peak memory {}\n", one_line(display_name(file_)),
        report.device, plural(report.frames, "frame"), report.size.width, report.size.height, fps,
        plural(report.stalls, "stall"), human_bytes(peak_memory()));
    STGS_TRY(session.emit(json, text));
    return report.screenshot;
  }
#endif

  std::string file_, camera_, size_, screenshot_, memory_ = "4G";
  double time_ = 0, rate_ = 1;
  int after_ = 1;
  bool loop_ = false, paused_ = false, no_overlay_ = false;
};

}  // namespace

std::unique_ptr<Command> make_play() {
  return std::make_unique<Play>();
}

}  // namespace stgs::tools
