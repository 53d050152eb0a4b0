// SPDX-License-Identifier: Apache-2.0
// Frames that are pushed while they are filmed become a file that grows.
#include "stgs/encoder/live_encoder.h"

#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <thread>

#include "catch.h"
#include "fixtures/played_psnr.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/format/scene_file.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

namespace {

constexpr int kFrames = 24;
constexpr double kFps = 20;

// Halving these undoes it exactly.
Camera twice(Camera camera) {
  camera.width *= 2;
  camera.height *= 2;
  for (double* value : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *value *= 2;
  return camera;
}
Image8 twice(const Image8& image) {
  Image8 out{2 * image.width, 2 * image.height, image.channels, {}};
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const std::uint8_t* pixel =
          &image.data[std::size_t{1} * image.channels * (y / 2 * image.width + x / 2)];
      out.data.insert(out.data.end(), pixel, pixel + image.channels);
    }
  }
  return out;
}

// Prepares frames of a synthetic capture with its own points. `enlarged`: the cameras are twice as
// large as those of the capture.
class KnownPoints final : public LivePreparer {
 public:
  explicit KnownPoints(const PreparedCapture& capture, bool enlarged = false)
      : capture_(capture), enlarged_(enlarged) {
    for (const Camera& camera : capture.training_cameras()) cameras_.push_back({camera.name, ""});
    points_ = *read_points(capture.folder + "/points_dynamic.ply");
  }
  const std::vector<LiveCamera>& cameras() const override { return cameras_; }
  double fps() const override { return kFps; }
  Result<Image8> convert(std::size_t, const LiveImage&) override {
    return runtime_error("not used");
  }
  Status check_sources() const override { return {}; }
  Status read_source(std::size_t, const LiveFrameSink&, const std::function<bool()>&,
                     const LogSink&) override {
    return runtime_error("not used");
  }
  Result<PreparedCapture> start(const std::vector<bool>& takes_part) override {
    PreparedCapture rig = capture_;
    rig.cameras.clear();
    const std::vector<Camera> training = capture_.training_cameras();
    for (std::size_t i = 0; i < training.size(); ++i)
      if (takes_part[i]) rig.cameras.push_back(enlarged_ ? twice(training[i]) : training[i]);
    rig.files.reset();
    rig.memory_only = true;
    rig.time_base = frame_time_of(kFps);
    return rig;
  }
  Status prepare(PreparedCapture& window, int point_interval, const ProgressSink&,
                 const LogSink&) override {
    if (fails_at == window.first_frame) return runtime_error("no points");
    std::this_thread::sleep_for(duration);
    intervals.push_back(point_interval);
    std::vector<InitialPoint> dynamics;
    for (InitialPoint point : points_) {
      point.frame -= window.first_frame;
      if (point.frame >= 0 && point.frame < window.frames) dynamics.push_back(point);
    }
    std::filesystem::copy_file(capture_.folder + "/points_static.ply",
                               window.folder + "/points_static.ply",
                               std::filesystem::copy_options::overwrite_existing);
    STGS_TRY(write_points(window.folder + "/points_dynamic.ply", dynamics));
    return write_prepared_capture(window);
  }

  std::vector<int> intervals;
  int fails_at = -1;
  std::chrono::milliseconds duration{0};  // of preparing a window, at least

 private:
  const PreparedCapture& capture_;
  const bool enlarged_;
  std::vector<LiveCamera> cameras_;
  std::vector<InitialPoint> points_;
};

struct Run {
  explicit Run(int frames = kFrames, bool is_enlarged = false)
      : synthetic{4, frames}, preparer{synthetic.capture, is_enlarged}, enlarged{is_enlarged} {}

  const SyntheticCapture synthetic;
  KnownPoints preparer;
  const bool enlarged;
  const std::string output = synthetic.capture.folder + "/live.stgs",
                    folder = synthetic.capture.folder + "/live";
  std::vector<LiveWindow> windows;
  double target_kbps = 0;

  std::unique_ptr<LiveEncoder> open() {
    LiveSettings settings;
    settings.stream.train = test::short_run(300);
    settings.stream.recording = output;
    settings.latency = 0.5;
    settings.first_seconds = 20;
    settings.start_seconds = 0.5;
    settings.target_kbps = target_kbps;
    std::filesystem::create_directory(folder);
    auto live = LiveEncoder::open(
        preparer, folder, settings, [this](const LiveWindow& w) { windows.push_back(w); }, nullptr);
    INFO(live.status().message());
    REQUIRE(live.ok());
    return std::move(*live);
  }
  // Pushes the frames of a window and waits until it is encoded.
  void film_window(LiveEncoder& live, int index) {
    for (int f = 8 * index; f < 8 * index + 8; ++f)
      for (std::size_t c = 0; c < preparer.cameras().size(); ++c) push(live, c, f);
    while (live.report().windows <= index && !live.ended())
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  void push(LiveEncoder& live, std::size_t camera, int frame) {
    const Camera of = synthetic.capture.training_cameras()[camera];
    const Image8 image = *load_frame(synthetic.capture, of, frame);
    live.push(camera, 100 + frame / kFps, enlarged ? twice(image) : image);
  }
};

// Limits the size of files of this process, bytes, until it is destroyed.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(std::uintmax_t bytes) {
    handler_ = std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = static_cast<rlim_t>(bytes);
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_{};
  void (*handler_)(int) = nullptr;
};

}  // namespace

TEST_CASE("frames that are pushed become a file, which can be read while it grows") {
  Run run;
  const auto live = run.open();
  const std::size_t cameras = run.preparer.cameras().size();
  for (int f = 0; f < 12; ++f)
    for (std::size_t c = 0; c < cameras; ++c) run.push(*live, c, f);
  // The first window is written once eight frames have arrived.
  while (live->report().windows == 0 && !live->ended())
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  {
    const auto growing = SceneReader::open(run.output);
    REQUIRE(growing.ok());
    CHECK((*growing)->form() == SceneForm::kGrowing);
    CHECK((*growing)->metadata().frames == 8);
  }
  for (int f = 12; f < kFrames; ++f)
    for (std::size_t c = 0; c < cameras; ++c) run.push(*live, c, f);
  const Status finished = live->finish(run.output);
  INFO(finished.message());
  REQUIRE(finished.ok());
  const LiveReport report = live->report();
  CHECK(report.frames == kFrames);
  CHECK(report.cameras == static_cast<int>(cameras));
  CHECK(report.received == cameras * kFrames);
  CHECK(report.dropped == 0);
  CHECK(report.missing == 0);
  CHECK(report.lost_frames == 0);
  CHECK(report.persistent > 50);
  CHECK(report.latency_median > 0);
  CHECK(report.latency_p95 >= report.latency_median);
  REQUIRE(run.windows.size() >= 2);
  CHECK(run.windows[0].frames == 8);
  CHECK(run.windows[1].first_frame == 8);
  CHECK(run.preparer.intervals[0] == 1);
  const auto scene = read_scene(run.output);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == kFrames);
  PreparedCapture timed = run.synthetic.capture;
  timed.time_base = frame_time_of(kFps);
  // The first window has its full iterations; the others arrive at once, as a backlog.
  std::vector<double> psnr = test::psnr_by_frame(run.output, timed);
  CHECK(*std::min_element(psnr.begin(), psnr.end()) > 15);
  psnr.resize(8);
  CHECK(test::mean_of(psnr) > 21);
  // The reported PSNR is that of the training cameras.
  std::vector<double> seen;
  timed.frames = 8;
  for (const Camera& camera : run.synthetic.capture.training_cameras()) {
    timed.cameras = {camera};
    const std::vector<double> of_camera = test::psnr_by_frame(run.output, timed);
    seen.insert(seen.end(), of_camera.begin(), of_camera.end());
  }
  CHECK(run.windows[0].psnr == Approx(test::mean_of(seen)).margin(1));
  double sum = 0;
  for (const LiveWindow& window : run.windows) sum += window.psnr * window.frames;
  CHECK(report.psnr == Approx(sum / kFrames));
}

TEST_CASE("a window without points or frames shows static content, and the next ones continue") {
  Run run;
  run.preparer.fails_at = 8;
  const auto live = run.open();
  const std::size_t cameras = run.preparer.cameras().size();
  for (int f = 0; f < kFrames; ++f) {
    for (std::size_t c = 0; c < cameras; ++c) {
      if (c == 1 && f >= 4 && f < 8) continue;  // a camera that stalls
      run.push(*live, c, f);
    }
    if (f == 7) {
      while (live->report().windows == 0 && !live->ended())
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    if (f == 15) {
      while (live->report().windows < 2 && !live->ended())
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  const Status finished = live->finish(run.output);
  INFO(finished.message());
  REQUIRE(finished.ok());
  const LiveReport report = live->report();
  CHECK(report.frames == kFrames);
  CHECK(report.lost_frames == 8);
  CHECK(report.missing == 4);
  REQUIRE(run.windows.size() == 3);
  CHECK_FALSE(run.windows[1].written);
  const auto scene = read_scene(run.output);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == kFrames);
}

TEST_CASE("a full disk costs the frames that cannot be written, and encoding continues") {
  Run run;
  const auto live = run.open();
  run.film_window(*live, 0);
  {
    // Writing beyond the limit fails instead of raising the signal.
    const FileSizeLimit full(std::filesystem::file_size(run.output) + 500);
    run.film_window(*live, 1);
  }
  run.film_window(*live, 2);
  const Status finished = live->finish(run.output);
  INFO(finished.message());
  REQUIRE(finished.ok());
  REQUIRE(run.windows.size() >= 3);
  CHECK(run.windows[0].written);
  CHECK_FALSE(run.windows[1].written);
  CHECK(run.windows[2].written);
  CHECK(live->report().lost_frames == run.windows[1].frames);
  const auto scene = read_scene(run.output);
  REQUIRE(scene.ok());
  CHECK(scene->metadata.frames == kFrames);
}

TEST_CASE("a limit of the bit rate leaves fewer primitives") {
  std::uint64_t primitives[2];
  for (const int limited : {0, 1}) {
    Run run;
    run.target_kbps = limited;  // the least
    const auto live = run.open();
    for (int index = 0; index < 3; ++index) run.film_window(*live, index);
    const Status finished = live->finish(run.output);
    INFO(finished.message());
    REQUIRE(finished.ok());
    REQUIRE(run.windows.size() == 3);
    primitives[limited] = run.windows[2].primitives;
  }
  CHECK(primitives[1] < primitives[0] / 2);
}

TEST_CASE(
    "images of a rig that is too slow to prepare are halved, and the file shows them as well") {
  constexpr int kWindows = 12;
  Run run(8 * kWindows, true);
  run.preparer.duration = std::chrono::milliseconds(600);  // of windows of 400 ms
  const auto live = run.open();
  int index = 0;
  do run.film_window(*live, index++);
  while (index < kWindows - 1 && live->report().scale == 1);
  run.film_window(*live, index++);
  const Status finished = live->finish(run.output);
  INFO(finished.message());
  REQUIRE(finished.ok());
  CHECK(run.windows[0].scale == 1);
  CHECK(run.windows.back().scale == 0.5);
  CHECK(live->report().scale < 1);
  CHECK(live->report().lost_frames == 0);
  PreparedCapture timed = run.synthetic.capture;
  timed.time_base = frame_time_of(kFps);
  timed.frames = 8 * index;
  const std::vector<double> psnr = test::psnr_by_frame(run.output, timed);
  const std::vector<double> halved(psnr.end() - 8, psnr.end());
  CHECK(test::mean_of(halved) > 20);
}

TEST_CASE("a camera that delivers nothing is left out, and one alone is an error") {
  Run run;
  {
    const auto live = run.open();
    const std::size_t cameras = run.preparer.cameras().size();
    for (int f = 0; f < 10; ++f)
      for (std::size_t c = 1; c < cameras; ++c) run.push(*live, c, f);
    REQUIRE(live->finish(run.output).ok());
    CHECK(live->report().cameras == static_cast<int>(cameras) - 1);
    CHECK(live->report().frames == 10);
  }
  std::filesystem::remove_all(run.folder);
  std::filesystem::remove(run.output);
  const auto live = run.open();
  for (int f = 0; f < 10; ++f) run.push(*live, 0, f);
  const Status failed = live->finish(run.output);
  CHECK(failed.code() == StatusCode::kRuntime);
  CHECK_THAT(failed.message(), Catch::Contains("fewer than 2 cameras"));
  CHECK_FALSE(std::filesystem::exists(run.output));
}

TEST_CASE("errors of the settings and of the folder are found at the start") {
  Run run;
  LiveSettings settings;
  settings.stream.train = test::short_run(10);
  settings.stream.recording = run.output;
  const auto code = [&] {
    return LiveEncoder::open(run.preparer, run.folder, settings, nullptr, nullptr).status().code();
  };
  std::filesystem::create_directory(run.folder);
  settings.stream.train.preset = "none";
  CHECK(code() == StatusCode::kUsage);
  settings.stream.train.preset = "fast";
  settings.stream.train.target_kbps = 100;
  CHECK(code() == StatusCode::kUsage);
  settings.stream.train.target_kbps = 0;
  std::ofstream(run.output) << "another recording";
  CHECK(code() == StatusCode::kUsage);
  CHECK(std::filesystem::file_size(run.output) > 0);
  std::filesystem::remove(run.output);
  std::ofstream(run.folder + "/file") << "x";
  CHECK(code() == StatusCode::kUsage);
}

TEST_CASE("a live encoder that is destroyed leaves a recording") {
  Run run;
  {
    const auto live = run.open();
    for (int f = 0; f < 10; ++f)
      for (std::size_t c = 0; c < run.preparer.cameras().size(); ++c) run.push(*live, c, f);
    while (live->report().windows == 0 && !live->ended())
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  const auto growing = SceneReader::open(run.output);
  REQUIRE(growing.ok());
  CHECK((*growing)->metadata().frames == 8);
}
