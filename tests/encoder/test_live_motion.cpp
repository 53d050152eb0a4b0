// SPDX-License-Identifier: Apache-2.0
// The masks of the windows of a live capture, with a finder in place of a GPU.
#include <opencv2/imgproc.hpp>

#include "catch.h"
#include "init/background.h"
#include "init/motion.h"
#include "stgs/encoder/frame_memory.h"

namespace stgs::encoder::init {
namespace {

constexpr int kFrames = 7, kMissing = 3, kInterval = 2;

// Finds masks by the code for the CPU.
class Finder final : public geometry::MotionFinder {
 public:
  std::string name() const override { return "test"; }
  Result<geometry::MedianBackground> find_background(
      const geometry::MedianSamples& samples) override {
    geometry::MedianBackground out;  // the first image
    const auto pixels = static_cast<std::size_t>(samples.width * samples.height);
    out.colour.resize(3 * pixels);
    out.valid.resize(pixels, 255);
    STGS_TRY(samples.image(0, out.colour.data()));
    return out;
  }
  Status find_motion(const geometry::MotionSequence& sequence) override {
    CHECK(!sequence.use_flow);
    const cv::Size size(sequence.width, sequence.height);
    const cv::Mat background(size, CV_8UC3, const_cast<std::uint8_t*>(sequence.background));
    const ChangeTest test = change_test(background, change_threshold(background, sequence.noise));
    for (int i = 0; i < sequence.frames; ++i) {
      cv::Mat image(size, CV_8UC3);
      STGS_TRY(sequence.image(i, image.data));
      const cv::Mat mask = motion_mask(image, test);
      STGS_TRY(sequence.take({i, mask.data, cv::countNonZero(mask)}));
      ++masks;
    }
    return {};
  }
  Result<std::vector<std::int16_t>> find_flow(const geometry::FlowPair&) override {
    return std::vector<std::int16_t>();
  }
  int masks = 0;
};

// A window of a camera in front of which a box moves. One frame is missing.
PreparedCapture window(int width, int height) {
  PreparedCapture out;
  Camera camera;
  camera.name = "a";
  camera.width = width;
  camera.height = height;
  out.cameras = {camera};
  out.frames = kFrames;
  out.memory = std::make_shared<FrameMemory>();
  out.memory_only = true;
  for (int f = 0; f < kFrames; ++f) {
    if (f == kMissing) continue;
    cv::Mat image(height, width, CV_8UC3, cv::Scalar(90, 100, 110));
    if (f > 0) image(cv::Rect(f * width / 10, height / 4, width / 8, height / 4)).setTo(220);
    out.memory->add_frame("a", f, Image8{width, height, 3, {image.datastart, image.dataend}});
  }
  return out;
}

ViewMotion motion_of(const PreparedCapture& capture, const InitSettings& settings,
                     geometry::MotionFinder* gpu) {
  const ProgressSink progress;
  const LogSink log;
  const Work work(progress, log);
  ViewMotion motion;
  const View view = make_view(capture.cameras[0], 320);
  const Status status = find_live_motion(capture, view, settings, gpu, work, &motion);
  INFO(status.message());
  REQUIRE(status.ok());
  return motion;
}

}  // namespace

TEST_CASE("a GPU masks the frames of a live window that have points, as the CPU does") {
  Finder gpu;
  InitSettings on_cpu, on_gpu;
  on_cpu.point_interval = on_gpu.point_interval = kInterval;
  on_cpu.live = std::make_shared<LiveBackgrounds>(60);
  on_gpu.live = std::make_shared<LiveBackgrounds>(60);
  on_gpu.live->add("a", unknown_background(make_view(window(640, 360).cameras[0], 320)));
  on_cpu.live->add("a", unknown_background(make_view(window(640, 360).cameras[0], 320)));
  int masks = 0;
  for (const cv::Size size : {cv::Size(640, 360), cv::Size(640, 360), cv::Size(160, 90)}) {
    const PreparedCapture a = window(size.width, size.height), b = window(size.width, size.height);
    const ViewMotion expected = motion_of(a, on_cpu, nullptr), found = motion_of(b, on_gpu, &gpu);
    CHECK(found.coverage == expected.coverage);
    CHECK(cv::norm(found.background, expected.background, cv::NORM_INF) == 0);
    for (int f = 0; f < kFrames; ++f) {
      const auto mask = b.memory->mask("a", f), same = a.memory->mask("a", f);
      REQUIRE((mask == nullptr) == (same == nullptr));
      if (mask == nullptr) continue;
      CHECK(f != kMissing);
      CHECK(mask->data == same->data);
      ++masks;
    }
  }
  CHECK(masks > 3);
  CHECK(gpu.masks == masks);
}

TEST_CASE("the levels of a change follow the rule that the CPU and CUDA share") {
  const std::vector<float> thresholds = {6, 6.999f, 127.5f, 127.75f, 254.9f, 255, 300};
  const cv::Mat threshold(1, static_cast<int>(thresholds.size()), CV_32F,
                          const_cast<float*>(thresholds.data()));
  const ChangeTest test = change_test(cv::Mat(threshold.size(), CV_8UC3, cv::Scalar()), threshold);
  for (int i = 0; i < threshold.cols; ++i) {
    for (int change = 0; change < 256; ++change) {
      const float t = thresholds[static_cast<std::size_t>(i)];
      const auto above = [&](const cv::Mat& level) {
        return change > level.at<std::uint8_t>(0, i);
      };
      const auto value = static_cast<float>(change);
      INFO("change " << change << ", threshold " << t);
      REQUIRE(above(test.weak) == geometry::is_weak_change(value, t, false));
      REQUIRE(above(test.strong) == geometry::is_strong_change(value, t, false));
      REQUIRE((above(test.weak) || above(test.flowing)) ==
              geometry::is_weak_change(value, t, true));
      REQUIRE((above(test.strong) || above(test.flowing)) ==
              geometry::is_strong_change(value, t, true));
    }
  }
}

TEST_CASE("tiny images have masks") {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(2, 9)}) {
    const cv::Mat background(size, CV_8UC3, cv::Scalar(10, 10, 10));
    const ChangeTest test = change_test(background, change_threshold(background, 1));
    CHECK(motion_mask(background, test).size() == size);
    CHECK(cv::countNonZero(motion_mask(background, test)) == 0);
    const cv::Mat changed(size, CV_8UC3, cv::Scalar(200, 10, 10));
    const cv::Mat mask = motion_mask(changed, test);
    CHECK(mask.size() == size);
  }
}

}  // namespace stgs::encoder::init
