// SPDX-License-Identifier: Apache-2.0
#include "play/viewer.h"

#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <deque>

#include "image_io.h"
#include "location.h"
#include "play/camera_control.h"
#include "play/frame_renderer.h"
#include "play/input.h"
#include "play/overlay.h"
#include "play/screen.h"
#include "play/screenshot_saver.h"
#include "play/window.h"
#include "printable.h"
#include "scene_capture.h"
#include "scene_file.h"

namespace stgs::tools {
namespace {

constexpr Size kDefaultSize{1280, 720};
constexpr double kIdleSeconds = 0.05;  // between polls while nothing changes
constexpr double kFpsSeconds = 1;      // averaging time of the frame rate
constexpr int kMaxAttempts = 4;        // at a screenshot with all splats
constexpr int kMaxPendingFrames =
    600;  // to wait, during playback, until none of a frame is pending

// The recent frame rate.
class FrameRateMeter {
 public:
  void add(double now) {
    times_.push_back(now);
    while (times_.size() > 2 && times_.front() < now - kFpsSeconds) times_.pop_front();
  }
  double per_second() const {
    const double span = times_.empty() ? 0 : times_.back() - times_.front();
    return span > 0 ? static_cast<double>(times_.size() - 1) / span : 0;
  }

 private:
  std::deque<double> times_;
};

class PlayWindow {
 public:
  PlayWindow(Session& session, const ViewerSettings& settings)
      : session_(session), settings_(settings), saver_(session) {}

  Status open() {
    STGS_ASSIGN(playback_, Playback::start(session_, settings_.playback));
    // Report a wrong file before opening the window, or failing to.
    if (!is_url(location())) STGS_TRY(SceneFile::open(session_, location()).status());
    STGS_ASSIGN(window_, Window::make("stgs play " + file(), initial_size()));
    std::function<void(const std::string&)> on_message;
    if (session_.options.log_level == "debug") {
      on_message = [this](const std::string& text) { session_.log(1, text); };
    }
    STGS_ASSIGN(device_, WindowDevice::make(window_->handle(), on_message));
    screen_ = std::make_unique<Screen>(*device_);
    ImGui::GetIO().Fonts->Build();
    STGS_TRY(screen_->create(window_->framebuffer_size()));
    if (!settings_.screenshot.empty() && !screen_->can_copy()) {
      return unsupported("--screenshot: the images of this window cannot be copied");
    }
    STGS_ASSIGN(renderer_, FrameRenderer::make(*device_));
    overlay_ = settings_.overlay;
    report_.device = device_->name();
    return {};
  }

  Status run() {
    while (!window_->closing() && !done_) {
      if (interrupted()) return runtime_error("playback stopped");
      const bool idle = is_idle();
      is_busy_ = is_busy_ && !idle;
      window_->poll(idle ? kIdleSeconds : 0);
      STGS_TRY(render_frame());
      saver_.report(false);
    }
    STGS_TRY(renderer_->wait());
    if (is_open_) report_.stalls = playback_->stalls();
    saver_.report(true);
    if (settings_.screenshot.empty() || done_) return {};
    return runtime_error("{}: the window was closed before it was written", settings_.screenshot);
  }

  const ViewerReport& report() const { return report_; }

 private:
  const std::string& location() const { return settings_.playback.file; }
  std::string file() const { return display_name(location()); }  // for messages

  Size initial_size() const {
    if (settings_.size) return *settings_.size;
    if (!settings_.camera) return kDefaultSize;
    const encoder::Camera& camera = *settings_.camera;
    const double scale = std::min({1.0, static_cast<double>(kDefaultSize.width) / camera.width,
                                   static_cast<double>(kDefaultSize.height) / camera.height});
    return {std::max(1, static_cast<int>(std::lround(scale * camera.width))),
            std::max(1, static_cast<int>(std::lround(scale * camera.height)))};
  }

  // Returns whether the next frame would equal the last, so that it need not follow at once.
  bool is_idle() const {
    return is_open_ && loaded_ && !moved_ && !save_ && settings_.screenshot.empty() &&
           !playback_->is_playing();
  }

  // Sets the camera and the size and title of the window, once the file is open.
  Status set_up() {
    stgs_scene* const scene = playback_->scene();
    const stgs_scene_info& info = playback_->info();
    base_view_ = sized<stgs_view>();
    const stgs_result result = stgs_scene_start_view(scene, &base_view_);
    if (result != STGS_ERROR_UNSUPPORTED) {  // there is a start camera
      STGS_TRY(status_of(result, scene, stgs_scene_error));
      if (!settings_.camera) {
        STGS_ASSIGN(settings_.camera, camera_of(base_view_, file()));
      }
    }
    if (!settings_.camera) settings_.camera = overview(info);
    camera_.emplace(*settings_.camera, info);
    const Size size = initial_size();
    if (!settings_.size) glfwSetWindowSize(window_->handle(), size.width, size.height);
    const std::string title = text_of(scene, STGS_TEXT_TITLE);
    if (!title.empty()) glfwSetWindowTitle(window_->handle(), one_line(title).c_str());
    return {};
  }

  Status render_frame() {
    const double now = now_seconds();
    if (!is_open_) {
      STGS_ASSIGN(is_open_, playback_->is_open(now));
      if (is_open_) STGS_TRY(set_up());
    }
    const double passed = std::min(now - now_, 0.1);
    now_ = now;
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
    handle_keys();
    if (is_open_) {
      STGS_ASSIGN(report_.seconds, playback_->advance(now));
      const bool dragged = drag_camera(*camera_, *window_);
      const bool flown = fly_camera(*camera_, *window_, passed);
      moved_ = dragged || flown;
      const OverlayState state = overlay_state(now);
      if (overlay_) draw_overlay(*playback_, state);
      has_statistics_ = state.fps > 0 && loaded_from_ > 0 && frame_.number >= loaded_from_;
    } else {
      (void)window_->take_drags();  // discard: there is no camera yet
      draw_opening(file());
    }
    ImGui::Render();
    const Size size = window_->framebuffer_size();
    STGS_ASSIGN(const auto next, screen_->begin(size));
    if (!next) {
      is_busy_ = false;
      window_->poll(kIdleSeconds);
      return {};
    }
    if (is_open_) STGS_TRY(render_scene(*next));
    return present();
  }

  OverlayState overlay_state(double now) {
    OverlayState state;
    state.device = report_.device;
    state.size = report_.size;
    state.fps = frame_rate_.per_second();
    state.frame_ms = state.fps > 0 ? 1000 / state.fps : 0;
    state.frame = frame_;
    state.notices = playback_->notices(now);
    return state;
  }

  Status render_scene(const Screen::Acquired& next) {
    report_.size = {static_cast<int>(next.image.width), static_cast<int>(next.image.height)};
    report_.camera = camera_->camera(report_.size);
    const stgs_view view = view_of(report_.camera, base_view_);
    loaded_ = playback_->is_loaded();
    STGS_ASSIGN(number_, renderer_->submit(playback_->scene(), report_.seconds, view, next));
    if (loaded_ && loaded_from_ == 0) loaded_from_ = number_;
    STGS_ASSIGN(frame_, renderer_->last_completed());
    count_frame();
    return {};
  }

  // Counts a frame. It is busy unless the loop idled before it or the window was hidden.
  void count_frame() {
    if (is_busy_) {
      report_.busy_seconds += now_ - last_frame_;
      ++report_.busy_frames;
    }
    last_frame_ = now_;
    is_busy_ = true;
    frame_rate_.add(now_);
    ++report_.frames;
  }

  // Presents the frame, and saves it if a screenshot was requested.
  Status present() {
    const bool at_end = !settings_.screenshot.empty() && loaded_ &&
                        (has_statistics_ || !overlay_) &&
                        report_.frames >= static_cast<std::uint64_t>(settings_.after);
    if (save_ && is_open_ && !screen_->can_copy()) {
      cancel_screenshot("the images of this window cannot be copied");
    }
    const bool save = is_open_ && (at_end || (save_ && !saver_.is_saving()));
    encoder::Image8 shown;
    STGS_TRY(screen_->end(*ImGui::GetDrawData(), is_open_, save ? &shown : nullptr));
    if (!save) return {};
    STGS_ASSIGN(frame_, renderer_->last_completed());
    // The renderer drops splats that exceed its buffers and enlarges them: try again.
    if (frame_.number != number_) return {};
    if (at_end && frame_.pending_primitives > 0 && ++pending_frames_ < kMaxPendingFrames) return {};
    if (frame_.complete == 0) {
      if (++attempts_ < kMaxAttempts) return {};
      constexpr const char* kWhy = "the splats cover more tiles than the device supports";
      if (at_end) return runtime_error("{}: {}", name_at_time(file(), report_.seconds), kWhy);
      cancel_screenshot(kWhy);
      return {};
    }
    attempts_ = 0;
    if (at_end) {
      done_ = true;
      if (frame_.pending_primitives > 0) {
        session_.log(1,
                     fmt::format("{}: the screenshot lacks {} primitives that were not uploaded "
                                 "yet; use --paused",
                                 name_at_time(file(), report_.seconds), frame_.pending_primitives));
      }
      if (!playback_->is_complete()) {
        report_.screenshot = runtime_error(
            "{}: the screenshot is incomplete: data is damaged, could not be read, or exceeds "
            "--memory",
            name_at_time(file(), report_.seconds));
      }
      return write_single_png(settings_.screenshot, shown, session_.log_sink());
    }
    save_ = false;
    saver_.save(std::move(shown));
    return {};
  }

  void cancel_screenshot(const char* why) {
    save_ = false;
    attempts_ = 0;
    playback_->warn(now_, fmt::format("no screenshot: {}", why));
  }

  void handle_keys() {
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
          if (is_open_) control_playback(*playback_, press);
      }
    }
  }

  Session& session_;
  ViewerSettings settings_;
  std::unique_ptr<Playback> playback_;
  std::unique_ptr<Window> window_;
  std::unique_ptr<WindowDevice> device_;
  std::unique_ptr<Screen> screen_;
  std::unique_ptr<FrameRenderer> renderer_;
  std::optional<CameraControl> camera_;
  stgs_view base_view_{};  // near plane and background of the scene
  ViewerReport report_;
  FrameRateMeter frame_rate_;
  stgs_vulkan_progress frame_{};  // the last completed frame
  std::uint64_t number_ = 0;      // of the last submitted frame
  double now_ = now_seconds();
  bool is_open_ = false, overlay_ = true, save_ = false, loaded_ = false, done_ = false;
  std::uint64_t loaded_from_ = 0;  // number of the first frame with all layers; 0: none yet
  bool has_statistics_ = false;    // the overlay shows the statistics of such a frame
  bool is_busy_ = false;           // the next frame follows without idling
  double last_frame_ = 0;          // time of the last frame, seconds
  int attempts_ = 0;               // at a screenshot, that lacked splats
  int pending_frames_ = 0;         // skipped for --screenshot because primitives were pending
  bool moved_ = false;             // the camera moved, or a button is held
  ScreenshotSaver saver_;
};

}  // namespace

Result<ViewerReport> run_viewer(Session& session, const ViewerSettings& settings) {
  PlayWindow window(session, settings);
  STGS_TRY(window.open());
  STGS_TRY(window.run());
  return window.report();
}

}  // namespace stgs::tools
