// SPDX-License-Identifier: Apache-2.0
#include "play/show.h"

#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <system_error>

#include "picture.h"
#include "play/camera_control.h"
#include "play/overlay.h"
#include "play/screen.h"
#include "play/window.h"
#include "printable.h"
#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

constexpr Size kFirstSize{1280, 720};  // where no other is asked for
constexpr double kIdle = 0.05;         // seconds between looks at a window in which nothing changes
constexpr double kWholeTurn = 6.2831853;  // radians, of a drag over the whole window
constexpr double kWheelStep = 0.9;        // of the distance
constexpr double kFlight = 0.5;           // of the distance to what is looked at, a second
constexpr double kFast = 4;               // times that, with the shift key
constexpr double kJump = 1;               // seconds, of an arrow with the shift key
constexpr double kRecent = 1;             // seconds that the rate of pictures is taken over
constexpr int kMostTries = 4;             // at a picture with room for all its splats
constexpr int kMostLate = 600;  // pictures, while it plays, for one with all that has come

// The rate of pictures of late.
class PictureRate {
 public:
  void add(double now) {
    times_.push_back(now);
    while (times_.size() > 2 && times_.front() < now - kRecent) times_.pop_front();
  }
  double per_second() const {
    const double span = times_.empty() ? 0 : times_.back() - times_.front();
    return span > 0 ? static_cast<double>(times_.size() - 1) / span : 0;
  }

 private:
  std::deque<double> times_;
};

// The first of stgs-001.png, stgs-002.png, ... that does not exist.
std::string free_name() {
  for (int i = 1;; ++i) {
    std::string name = fmt::format("stgs-{:03}.png", i);
    std::error_code error;
    if (!std::filesystem::exists(name, error)) return name;
  }
}

class Show {
 public:
  Show(Session& session, const ShowSettings& settings)
      : session_(session), settings_(settings), playback_(session, settings.playback) {}
  // A screenshot that is still being written.
  ~Show() {
    if (saving_.valid()) saving_.wait();
  }

  Status open() {
    // A wrong path is told before the window, or that there is no display for one.
    if (!player::is_url(place())) STGS_TRY(player::open_location(place()).status());
    STGS_ASSIGN(window_, Window::make("stgs play " + file(), first_size()));
    std::function<void(const std::string&)> on_message;
    if (session_.options.log_level == "debug") {
      on_message = [this](const std::string& text) { session_.log(1, text); };
    }
    STGS_ASSIGN(device_, WindowDevice::make(window_->handle(), on_message));
    screen_ = std::make_unique<Screen>(*device_);
    ImGui::GetIO().Fonts->Build();
    STGS_TRY(screen_->create(window_->picture_size()));
    if (!settings_.screenshot.empty() && !screen_->can_copy()) {
      return unsupported("--screenshot: the pictures of this window cannot be copied");
    }
    STGS_ASSIGN(renderer_, player::make_vulkan_renderer(device_->device()));
    overlay_ = settings_.overlay;
    report_.device = device_->name();
    return {};
  }

  Status run() {
    while (!window_->closing() && !done_) {
      if (interrupted()) return runtime_error("the window is closed");
      const bool still = is_still();
      follows_ = follows_ && !still;
      window_->look(still ? kIdle : 0);
      STGS_TRY(picture());
      STGS_TRY(look_at_saving(false));
    }
    STGS_TRY(renderer_->wait());
    if (is_open_) report_.stalls = playback_.stalls();
    STGS_TRY(look_at_saving(true));
    if (settings_.screenshot.empty() || done_) return {};
    return runtime_error("{}: the window was closed before it was written", settings_.screenshot);
  }

  const ShowReport& report() const { return report_; }

 private:
  const std::string& place() const { return settings_.playback.file; }
  std::string file() const { return player::display_location(place()); }  // for messages

  Size first_size() const {
    if (settings_.size) return *settings_.size;
    if (!settings_.camera) return kFirstSize;
    const encoder::Camera& camera = *settings_.camera;
    const double scale = std::min({1.0, static_cast<double>(kFirstSize.width) / camera.width,
                                   static_cast<double>(kFirstSize.height) / camera.height});
    return {std::max(1, static_cast<int>(std::lround(scale * camera.width))),
            std::max(1, static_cast<int>(std::lround(scale * camera.height)))};
  }

  // Whether the next picture is as the last: then it need not come as fast as the screen shows
  // them.
  bool is_still() const {
    return is_open_ && settled_ && !moved_ && !save_ && settings_.screenshot.empty() &&
           !playback_.is_playing();
  }

  // Once the file is open: where to look from, and how large the window is to be.
  Status set_up() {
    const SceneMetadata& scene = playback_.player().timeline().metadata();
    if (!settings_.camera && scene.start_camera) {
      STGS_ASSIGN(settings_.camera, camera_of(*scene.start_camera, file()));
    }
    if (!settings_.camera) settings_.camera = overview(scene);
    camera_.emplace(*settings_.camera, scene);
    const Size size = first_size();
    if (!settings_.size) glfwSetWindowSize(window_->handle(), size.width, size.height);
    if (!scene.title.empty()) glfwSetWindowTitle(window_->handle(), one_line(scene.title).c_str());
    return {};
  }

  Status picture() {
    if (!is_open_) {
      STGS_ASSIGN(is_open_, playback_.is_open());
      if (is_open_) STGS_TRY(set_up());
    }
    const double now = now_seconds();
    const double passed = std::min(now - last_, 0.1);
    last_ = now;
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
    take_keys();
    if (is_open_) {
      report_.seconds = playback_.advance(now);
      const bool dragged = drag(), flown = fly(passed);
      moved_ = dragged || flown;
      const OverlayFacts told = facts(now);
      if (overlay_) draw_overlay(playback_, told);
      told_ = told.fps > 0 && whole_from_ > 0 && frame_.number >= whole_from_;
    } else {
      (void)window_->take_drags();  // of nothing
      draw_opening(file());
    }
    ImGui::Render();
    const Size size = window_->picture_size();
    STGS_ASSIGN(const auto next, screen_->begin(size));
    if (!next) {
      follows_ = false;
      window_->look(kIdle);
      return {};
    }
    if (is_open_) STGS_TRY(draw_scene(*next));
    return finish();
  }

  OverlayFacts facts(double now) {
    OverlayFacts facts;
    facts.device = report_.device;
    facts.size = report_.size;
    facts.fps = rate_.per_second();
    facts.frame_ms = facts.fps > 0 ? 1000 / facts.fps : 0;
    facts.stats = frame_.stats;
    facts.notices = playback_.notices(now);
    return facts;
  }

  Status draw_scene(const Screen::Picture& next) {
    report_.size = {static_cast<int>(next.image.width), static_cast<int>(next.image.height)};
    report_.camera = camera_->camera(report_.size);
    player::Timeline& timeline = playback_.player().timeline();
    const SceneMetadata& scene = timeline.metadata();
    player::View view;
    view.camera = report_.camera.pinhole(scene.near_plane);
    view.background = {scene.background[0], scene.background[1], scene.background[2]};
    player::VulkanSubmission to;
    to.targets = {{next.image, {}}};
    to.wait = {{next.free, 0}};
    settled_ = playback_.is_settled();
    STGS_ASSIGN(number_, renderer_->submit(timeline, report_.seconds, {view}, to));
    if (settled_ && whole_from_ == 0) whole_from_ = number_;
    STGS_ASSIGN(frame_, renderer_->last_completed());
    count_picture();
    return {};
  }

  // Pictures follow each other at once but where nothing changes, or the window is not shown.
  void count_picture() {
    if (follows_) {
      report_.busy += last_ - drawn_;
      ++report_.following;
    }
    drawn_ = last_;
    follows_ = true;
    rate_.add(last_);
    ++report_.pictures;
  }

  // Shows the picture, and keeps it where it is asked for.
  Status finish() {
    const bool at_end = !settings_.screenshot.empty() && settled_ && (told_ || !overlay_) &&
                        report_.pictures >= static_cast<std::uint64_t>(settings_.after);
    if (save_ && is_open_ && !screen_->can_copy()) {
      give_up_screenshot("the pictures of this window cannot be copied");
    }
    const bool keep = is_open_ && (at_end || (save_ && !saving_.valid()));
    encoder::Image8 shown;
    STGS_TRY(screen_->end(*ImGui::GetDrawData(), is_open_, keep ? &shown : nullptr));
    if (!keep) return {};
    STGS_ASSIGN(frame_, renderer_->last_completed());
    // One that lacks splats is drawn again, with the room that it needed, where there is as much.
    if (frame_.number != number_) return {};
    if (at_end && frame_.stats.pending > 0 && ++late_ < kMostLate) return {};
    if (!frame_.complete) {
      if (++cut_ < kMostTries) return {};
      constexpr const char* kWhy = "the splats touch more tiles than the device can list";
      if (at_end) return runtime_error("{}: {}", moment_name(file(), report_.seconds), kWhy);
      give_up_screenshot(kWhy);
      return {};
    }
    cut_ = 0;
    if (at_end) {
      done_ = true;
      if (frame_.stats.pending > 0) {
        session_.log(1, fmt::format("{}: the screenshot lacks {} primitives that the device had "
                                    "not got yet; use --paused",
                                    moment_name(file(), report_.seconds), frame_.stats.pending));
      }
      if (!playback_.is_whole()) {
        session_.log(1, fmt::format("{}: the screenshot lacks what is damaged, could not be read, "
                                    "or has no room in --memory",
                                    moment_name(file(), report_.seconds)));
      }
      return write_png(settings_.screenshot, shown);
    }
    save_ = false;
    saving_ = std::async(std::launch::async, [shown = std::move(shown)]() -> Result<std::string> {
      std::string name = free_name();
      STGS_TRY(write_png(name, shown));
      return name;
    });
    return {};
  }

  void give_up_screenshot(const char* why) {
    save_ = false;
    cut_ = 0;
    playback_.warn(last_, fmt::format("no screenshot: {}", why));
  }

  // Tells where a screenshot is, once it is.
  Status look_at_saving(bool wait) {
    if (!saving_.valid()) return {};
    if (!wait && saving_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return {};
    const Result<std::string> name = saving_.get();
    if (name.ok()) {
      session_.log(2, "screenshot: " + *name);
    } else {
      session_.log(1, "no screenshot: " + name.status().message());
    }
    return {};
  }

  void take_keys() {
    for (const KeyPress& press : window_->take_keys()) {
      switch (press.key) {
        case GLFW_KEY_ESCAPE:
          window_->close();
          break;
        case GLFW_KEY_F1:
          overlay_ = !overlay_;
          break;
        case GLFW_KEY_F12:
        case GLFW_KEY_P:
          save_ = true;
          break;
        case GLFW_KEY_R:
          if (camera_) camera_->reset();
          break;
        default:
          if (is_open_) control(press);
      }
    }
  }

  void control(const KeyPress& press) {
    const double now = playback_.player().seconds();
    switch (press.key) {
      case GLFW_KEY_SPACE:
        return playback_.toggle_pause();
      case GLFW_KEY_LEFT:
        return press.shift ? playback_.seek(now - kJump) : playback_.step(-1);
      case GLFW_KEY_RIGHT:
        return press.shift ? playback_.seek(now + kJump) : playback_.step(1);
      case GLFW_KEY_UP:
        return playback_.change_rate(1);
      case GLFW_KEY_DOWN:
        return playback_.change_rate(-1);
      case GLFW_KEY_HOME:
        return playback_.seek(0);
      case GLFW_KEY_END:
        return playback_.seek(playback_.duration());
      case GLFW_KEY_L:
        return playback_.toggle_loop();
      default:
        return;
    }
  }

  // By the mouse; whether one of its buttons holds the scene.
  bool drag() {
    const ImGuiIO& io = ImGui::GetIO();
    const auto [left, right, middle] = window_->take_drags();
    if (io.WantCaptureMouse) return false;
    const double radians = kWholeTurn / std::max(io.DisplaySize.y, 1.0f);
    if (left.held) camera_->orbit(-radians * left.x, radians * left.y);
    if (right.held) camera_->look(radians * right.x, -radians * right.y);
    if (middle.held) {
      const double units = camera_->distance() / std::max(io.DisplaySize.y, 1.0f);
      camera_->move(-units * middle.x, units * middle.y, 0);
    }
    if (io.MouseWheel != 0) camera_->approach(std::pow(kWheelStep, io.MouseWheel));
    return left.held || right.held || middle.held;
  }

  // By the keys that are held down, if any are.
  bool fly(double passed) {
    const auto axis = [&](int plus, int minus) {
      return static_cast<double>(window_->is_down(plus)) -
             static_cast<double>(window_->is_down(minus));
    };
    const double right = axis(GLFW_KEY_D, GLFW_KEY_A), up = axis(GLFW_KEY_E, GLFW_KEY_Q),
                 forward = axis(GLFW_KEY_W, GLFW_KEY_S);
    if (right == 0 && up == 0 && forward == 0) return false;
    const bool fast =
        window_->is_down(GLFW_KEY_LEFT_SHIFT) || window_->is_down(GLFW_KEY_RIGHT_SHIFT);
    const double way = passed * kFlight * camera_->distance() * (fast ? kFast : 1);
    camera_->move(way * right, way * up, way * forward);
    return true;
  }

  Session& session_;
  ShowSettings settings_;
  Playback playback_;
  std::unique_ptr<Window> window_;
  std::unique_ptr<WindowDevice> device_;
  std::unique_ptr<Screen> screen_;
  std::unique_ptr<player::VulkanRenderer> renderer_;
  std::optional<CameraControl> camera_;
  ShowReport report_;
  PictureRate rate_;
  player::VulkanFrame frame_;  // the last one that has ended
  std::uint64_t number_ = 0;   // of the last one that was submitted
  double last_ = now_seconds();
  bool is_open_ = false, overlay_ = true, save_ = false, settled_ = false, done_ = false;
  std::uint64_t whole_from_ = 0;  // the first picture of all that a moment has; 0: none yet
  bool told_ = false;             // whether the overlay has the figures of such a picture
  bool follows_ = false;          // the next picture the last, at once
  double drawn_ = 0;              // the last picture, seconds
  int cut_ = 0;                   // tries at a screenshot that lacked splats
  int late_ = 0;                  // pictures in whose stead the next was to be kept
  bool moved_ = false;            // the camera, or the viewer is about to
  std::future<Result<std::string>> saving_;
};

}  // namespace

Result<ShowReport> show(Session& session, const ShowSettings& settings) {
  Show shown(session, settings);
  STGS_TRY(shown.open());
  STGS_TRY(shown.run());
  return shown.report();
}

}  // namespace stgs::tools
