// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>

#include "camera_file.h"
#include "command.h"
#include "options.h"
#ifdef STGS_HAS_PLAY
#include "play/show.h"
#include "stgs/encoder/camera_json.h"
#include "stgs/player/source.h"
#endif

namespace stgs::tools {
namespace {

class Play final : public Command {
 public:
  Help help() const override {
    return {
        "play", "Show a .stgs file in a window, from any viewpoint",
        "Draws with Vulkan while the file is still coming: from a disk, or from a server that\n"
        "answers byte ranges.\n"
        "Mouse: left drag turns around the scene, right drag looks around, middle drag shifts,\n"
        "the wheel goes nearer. The bar at the bottom shows what has come, and seeks.\n"
        "Keys: space pause, left and right a frame (with shift a second), up and down speed,\n"
        "home and end, L loop, W A S D E Q fly (shift: faster), R back to the start camera,\n"
        "F1 hides all but the scene, P or F12 writes a screenshot (stgs-001.png and so on),\n"
        "escape closes.",
        "  stgs play scene.stgs --loop\n"
        "  stgs play https://example.org/scene.stgs --size 1920x1080\n"
        "  stgs play scene.stgs --time 0.5 --paused --screenshot window.png"};
  }

  Shared shared() const override { return {.log_level = true, .threads = true}; }

  void declare(CLI::App& app) override {
    app.add_option("FILE", file_, "The .stgs file, or its URL")->required();
    app.add_option("--start-camera,--camera", camera_,
                   "Camera file (JSON, as of 'stgs render'); else the file's start camera");
    app.add_option("--size", size_,
                   "WIDTHxHEIGHT of the window; else the camera's, at most 1280x720");
    app.add_option("--time", time_,
                   "Moment to begin at, seconds; 0: of a recording that grows near its end")
        ->check(number_between(0, 1e9))
        ->capture_default_str();
    app.add_option("--rate", rate_, "Speed, -2 to 4 and not 0")
        ->check(number_between(-2, 4))
        ->capture_default_str();
    app.add_flag("--loop", loop_, "Begin again at the end");
    app.add_flag("--paused", paused_, "Begin paused");
    app.add_flag("--no-overlay", no_overlay_, "Show the scene alone (F1 brings the rest)");
    app.add_option("--memory", memory_mb_, "Fetched and decoded data held at most, MB (10^6 bytes)")
        ->check(number_between(1, 1e9))
        ->capture_default_str();
    auto* screenshot = app.add_option(
        "--screenshot", screenshot_,
        "Write what the window shows to this .png, once all of the moment and the statistics are "
        "there, and end; without --paused it plays on until then");
    app.add_option("--after", after_, "Of --screenshot: not before so many pictures")
        ->check(number_between(1, 1e9))
        ->capture_default_str()
        ->needs(screenshot);
  }

  Status run(Session& session) override {
    if (rate_ == 0) return usage_error("--rate 0 does not play; give --paused");
    if (!screenshot_.empty() && extension_is_not_png()) {
      return usage_error("--screenshot {}: a screenshot is a .png", screenshot_);
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
    ShowSettings settings;
    settings.playback.file = file_;
    settings.playback.seconds = time_;
    settings.playback.rate = rate_;
    settings.playback.paused = paused_;
    settings.playback.loop = loop_;
    settings.playback.memory = static_cast<std::uint64_t>(memory_mb_ * 1e6);
    settings.camera = camera;
    settings.size = size;
    settings.overlay = !no_overlay_;
    settings.screenshot = screenshot_;
    settings.after = after_;
    STGS_ASSIGN(const ShowReport report, show(session, settings));
    return tell(session, report);
#else
    (void)session;
    return not_built(
        "'play' is not part of this build: it needs GLFW, Dear ImGui and Vulkan (Debian: "
        "libglfw3-dev, libimgui-dev, libvulkan-dev, libvulkan-volk-dev, glslc); 'stgs render' "
        "draws "
        "pictures");
#endif
  }

 private:
  bool extension_is_not_png() const {
    constexpr std::string_view kEnding = ".png";
    return screenshot_.size() < kEnding.size() ||
           screenshot_.compare(screenshot_.size() - kEnding.size(), kEnding.size(), kEnding) != 0;
  }

#ifdef STGS_HAS_PLAY
  std::string shown_file() const {
    return player::display_location(file_);
  }

  Status tell(Session& session, const ShowReport& report) const {
    const double fps = report.busy > 0 ? static_cast<double>(report.following) / report.busy : 0;
    Json json = {{"file", shown_file()},
                 {"device", report.device},
                 {"width", report.size.width},
                 {"height", report.size.height},
                 {"frames_shown", report.pictures},
                 {"fps", fps},
                 {"stalls", report.stalls},
                 {"seconds", report.seconds},
                 {"camera", nullptr},
                 {"screenshot", nullptr},
                 { "peak_memory", peak_memory() }};
    if (report.pictures > 0) json["camera"] = encoder::camera_to_json(report.camera);
    if (!screenshot_.empty()) json["screenshot"] = screenshot_;
    const std::string text =
        fmt::format("{} on {}: {} pictures of {}x{} ({:.1f} a second), {} stalls, peak memory {}\n",
                    shown_file(), report.device, report.pictures, report.size.width,
                    report.size.height, fps, report.stalls, human_bytes(peak_memory()));
    return session.emit(json, text);
  }
#endif

  std::string file_, camera_, size_, screenshot_;
  double time_ = 0, rate_ = 1, memory_mb_ = 4096;
  int after_ = 1;
  bool loop_ = false, paused_ = false, no_overlay_ = false;
};

}  // namespace

std::unique_ptr<Command> make_play() {
  return std::make_unique<Play>();
}

}  // namespace stgs::tools
