// SPDX-License-Identifier: Apache-2.0
// Live sessions of the C API: images that cameras push become a file that grows.
#include <atomic>
#include <barrier>
#include <mutex>

#include "sdk_live_fixture.h"

namespace stgs::testing {
namespace {

stgs_form form_of(const ScenePtr& scene) {
  auto contents = empty_output<stgs_contents>();
  REQUIRE(stgs_scene_get_contents(scene.get(), &contents) == STGS_OK);
  return contents.form;
}

// Windows and log lines that a session reports on its threads.
struct Observed {
  std::mutex mutex;
  std::vector<stgs_live_window> windows;
  std::vector<std::string> lines;

  void attach(stgs_live_settings& settings) {
    settings.window_user = settings.log_user = this;
    settings.window = [](void* user, const stgs_live_window* window) {
      auto* self = static_cast<Observed*>(user);
      const std::lock_guard lock(self->mutex);
      self->windows.push_back(*window);
    };
    settings.log = [](void* user, stgs_log_level, const char* line) {
      auto* self = static_cast<Observed*>(user);
      const std::lock_guard lock(self->mutex);
      self->lines.emplace_back(line);
    };
  }
};

}  // namespace

TEST_CASE("cameras on several threads become a scene, which can be read while it grows", "[sdk]") {
  const FilmedCapture filmed;
  Observed observed;
  stgs_live_settings settings = filmed.settings();
  settings.threads = 2;
  settings.title = "three cameras";
  observed.attach(settings);
  LivePtr live = filmed.start(settings);
  CHECK(report_of(live).ended == 0);
  std::atomic<int> failures = 0;
  std::barrier frame_filmed(static_cast<std::ptrdiff_t>(filmed.cameras.size()));
  const auto film = [&](int begin, int end) {
    std::vector<std::thread> threads;
    for (std::size_t c = 0; c < filmed.cameras.size(); ++c) {
      threads.emplace_back([&, c] {
        for (int f = begin; f < end; ++f) {
          failures += filmed.push(live, c, f) == STGS_OK ? 0 : 1;
          frame_filmed.arrive_and_wait();
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
  };
  film(0, 12);
  wait_for_windows(live, 1);
  CHECK(info_of(open_path(filmed.recording)).frames == 8);
  CHECK(form_of(open_path(filmed.recording)) == STGS_FORM_GROWING);
  film(12, filmed.kFrames);
  const stgs_result result = stgs_live_finish(live.get(), nullptr);
  INFO(message_of(live));
  REQUIRE(result == STGS_OK);
  CHECK(failures == 0);
  const stgs_live_report report = report_of(live);
  CHECK(report.cameras == 3);
  CHECK(report.frames == filmed.kFrames);
  CHECK(report.images == 3 * filmed.kFrames);
  CHECK(report.dropped == 0);
  CHECK(report.missing == 0);
  CHECK(report.lost_frames == 0);
  CHECK(report.ended == 1);
  CHECK(report.windows == observed.windows.size());
  CHECK(report.latency_median > 0);
  CHECK(report.latency_max >= report.latency_p95);
  REQUIRE(observed.windows.size() >= 2);
  CHECK(observed.windows[0].struct_size == sizeof(stgs_live_window));
  CHECK(observed.windows[0].frames == 8);
  CHECK(observed.windows[1].first_frame == 8);
  CHECK(observed.windows[1].written == 1);
  CHECK(observed.windows[0].psnr > 19);
  CHECK(report.psnr > 15);
  CHECK(observed.windows[0].scale == 1);
  CHECK(report.scale == Approx(1));
  const ScenePtr scene = open_path(filmed.recording);
  CHECK(info_of(scene).frames == filmed.kFrames);
  CHECK(form_of(scene) == STGS_FORM_RECORDED);
  CHECK(info_of(scene).primitives == report.primitives);
  CHECK(psnr_of(filmed, scene, {1, 6}) > 19);
  live.reset();
  for (const std::string& name : file_names_in(filmed.synthetic.capture.folder)) {
    INFO(name << " is a lock or a work folder that remains");
    CHECK(name[0] != '.');
  }
}

TEST_CASE("the scene can be a second file, next to the recording", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  filmed.push_all(live, 0, 10);
  CHECK(stgs_live_finish(live.get(), filmed.path("no/scene.stgs").c_str()) == STGS_ERROR_IO);
  CHECK(stgs_live_finish(live.get(), filmed.recording.c_str()) == STGS_ERROR_ARGUMENT);
  REQUIRE(stgs_live_end_camera(live.get(), filmed.calibration[0].name) == STGS_OK);
  const std::string scene = filmed.path("scene.stgs");
  REQUIRE(stgs_live_finish(live.get(), scene.c_str()) == STGS_OK);
  CHECK(info_of(open_path(scene)).frames == 10);
  CHECK(form_of(open_path(scene)) == STGS_FORM_FINISHED);
  CHECK(info_of(open_path(filmed.recording)).frames == 10);
  CHECK(form_of(open_path(filmed.recording)) == STGS_FORM_RECORDED);
}

TEST_CASE("images out of time are counted, and those of an ended camera ignored", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  const char* const camera = filmed.calibration[1].name;
  filmed.push_all(live, 0, 10);
  wait_for_windows(live, 1);
  REQUIRE(filmed.push(live, 1, 9) == STGS_OK);  // repeated
  REQUIRE(filmed.push(live, 1, 0) == STGS_OK);  // late
  const LivePixels pixels = filmed.pixels(1, 10);
  REQUIRE(stgs_live_push(live.get(), camera, 2e6, &pixels.image) == STGS_OK);  // ahead
  REQUIRE(stgs_live_end_camera(live.get(), camera) == STGS_OK);
  for (const std::size_t c : {0, 1, 2}) REQUIRE(filmed.push(live, c, 10) == STGS_OK);
  REQUIRE(stgs_live_finish(live.get(), nullptr) == STGS_OK);
  const stgs_live_report report = report_of(live);
  CHECK(report.images == 36);
  CHECK(report.dropped_repeated == 1);
  CHECK(report.dropped_late == 1);
  CHECK(report.dropped_ahead == 1);
  CHECK(report.dropped == 3);
  CHECK(report.missing == 1);
  CHECK(report.frames == 11);
}

TEST_CASE("a session that is destroyed leaves a recording", "[sdk]") {
  const FilmedCapture filmed;
  {
    const LivePtr live = filmed.start(filmed.settings());
    filmed.push_all(live, 0, 10);
    wait_for_windows(live, 1);
  }
  CHECK(info_of(open_path(filmed.recording)).frames == 8);
}

TEST_CASE("a session can be cancelled while it finishes, and then only reports", "[sdk]") {
  const FilmedCapture filmed;
  stgs_live_settings settings = filmed.settings();
  stgs_live* in_callback = nullptr;
  settings.window_user = &in_callback;
  settings.window = [](void* user, const stgs_live_window*) {
    stgs_live_cancel(*static_cast<stgs_live**>(user));
  };
  const LivePtr live = make_live();
  in_callback = live.get();
  REQUIRE(stgs_live_start(live.get(), filmed.recording.c_str(), &settings) == STGS_OK);
  filmed.push_all(live, 0, filmed.kFrames);
  CHECK(stgs_live_finish(live.get(), nullptr) == STGS_ERROR_CANCELLED);
  CHECK(filmed.push(live, 0, 0) == STGS_ERROR_CANCELLED);
  CHECK(stgs_live_end_camera(live.get(), filmed.calibration[0].name) == STGS_ERROR_CANCELLED);
  CHECK(stgs_live_finish(live.get(), nullptr) == STGS_ERROR_CANCELLED);
  CHECK(report_of(live).windows >= 1);
  CHECK(info_of(open_path(filmed.recording)).frames >= 8);
}

TEST_CASE("a session with one camera fails when it finishes, without a recording", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  for (int f = 0; f < 10; ++f) REQUIRE(filmed.push(live, 0, f) == STGS_OK);
  CHECK(stgs_live_finish(live.get(), nullptr) == STGS_ERROR_RUNTIME);
  CHECK(message_of(live).find("fewer than 2 cameras") != std::string::npos);
  CHECK_FALSE(fs::exists(filmed.recording));
  CHECK(stgs_live_finish(live.get(), nullptr) == STGS_ERROR_STATE);
}

}  // namespace stgs::testing
