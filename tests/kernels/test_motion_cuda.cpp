// SPDX-License-Identifier: Apache-2.0
// Compares motion detection on CUDA with the CPU. Exit code 77: no device. The hidden test
// [.times] prints how long both take.
#include <chrono>
#include <cstdio>
#include <thread>

#include "catch.h"
#include "catch_runner.h"
#include "encoder/motion_reference.h"
#include "encoder/moving_texture.h"
#include "geometry/motion_rule.h"
#include "geometry/view_matcher.h"
#include "init/background.h"
#include "init/motion.h"
#include "init/motion_gpu.h"
#include "stgs/encoder/frame_memory.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;
using namespace stgs::testing;
using geometry::FrameMotion;
using geometry::MotionFinder;
using geometry::MotionSequence;

namespace {

std::unique_ptr<MotionFinder> on_gpu() {
  auto finder = geometry::make_cuda_motion_finder(0);
  INFO(finder.status().message());
  REQUIRE(finder.ok());
  return std::move(*finder);
}

Image8 image8(const cv::Mat& mat) {
  return {mat.cols, mat.rows, mat.channels(), {mat.datastart, mat.dataend}};
}

// A capture in memory with one camera.
struct MemoryCapture {
  PreparedCapture capture;
  View view;

  explicit MemoryCapture(const std::vector<cv::Mat>& images, const std::vector<cv::Mat>& masks) {
    capture.memory = std::make_shared<FrameMemory>();
    capture.memory_only = true;
    capture.frames = static_cast<int>(images.size());
    Camera camera;
    camera.name = "a";
    camera.width = images[0].cols;
    camera.height = images[0].rows;
    camera.fx = camera.fy = 100;
    capture.cameras.push_back(camera);
    for (std::size_t i = 0; i < images.size(); ++i)
      capture.memory->add_frame("a", static_cast<int>(i), image8(images[i]));
    for (std::size_t i = 0; i < masks.size(); ++i)
      if (!masks[i].empty()) capture.memory->add_mask("a", static_cast<int>(i), image8(masks[i]));
    view = make_view(capture.cameras[0], 640);
  }
};

struct Found {
  Status status;
  std::vector<int> frames, masked;
  std::vector<cv::Mat> masks, flow;  // `flow`: CV_16SC2, empty without
};

// Detects the motion of images, without assertions, for threads. `flow`: given, or empty.
Found detect(MotionFinder& gpu, const std::vector<cv::Mat>& images, const Background& background,
             const std::vector<cv::Mat>& flow, bool use_flow) {
  Found out;
  MotionSequence sequence;
  sequence.width = images[0].cols;
  sequence.height = images[0].rows;
  sequence.frames = static_cast<int>(images.size());
  sequence.background = background.colour.data;
  sequence.noise = background.noise;
  sequence.use_flow = use_flow;
  sequence.image = [&](int i, std::uint8_t* rgb) -> Status {
    if (images[i].empty()) return io_error("no image");
    std::copy(images[i].datastart, images[i].dataend, rgb);
    return {};
  };
  if (!flow.empty()) {
    sequence.flow = [&](int i, float* to) -> Status {
      std::copy_n(flow[i].ptr<float>(), 2 * flow[i].total(), to);
      return {};
    };
  }
  sequence.take = [&](const FrameMotion& motion) -> Status {
    const cv::Size size = images[0].size();
    out.frames.push_back(motion.frame);
    out.masked.push_back(motion.masked);
    out.masks.push_back(cv::Mat(size, CV_8U, const_cast<std::uint8_t*>(motion.mask)).clone());
    out.flow.emplace_back();
    if (motion.flow != nullptr) {
      out.flow.back() = cv::Mat((size.height + 1) / 2, (size.width + 1) / 2, CV_16SC2,
                                const_cast<std::int16_t*>(motion.flow))
                            .clone();
    }
    return {};
  };
  out.status = gpu.find_motion(sequence);
  return out;
}

// Checks that a result has all frames.
void check_complete(const Found& found, std::size_t frames) {
  INFO(found.status.message());
  REQUIRE(found.status.ok());
  REQUIRE(found.masks.size() == frames);
  for (std::size_t i = 0; i < frames; ++i) {
    CHECK(found.frames[i] == static_cast<int>(i));
    CHECK(found.masked[i] == cv::countNonZero(found.masks[i]));
  }
}

Found found_on(MotionFinder& gpu, const std::vector<cv::Mat>& images, const Background& background,
               const std::vector<cv::Mat>& flow, bool use_flow = true) {
  Found out = detect(gpu, images, background, flow, use_flow);
  check_complete(out, images.size());
  return out;
}

// The masks of images with a flow from each to the next, by the code for the CPU.
std::vector<cv::Mat> cpu_masks(const std::vector<cv::Mat>& images, const Background& background,
                               const std::vector<cv::Mat>& flow) {
  std::vector<cv::Mat> out;
  const ChangeTest test =
      change_test(background.colour, change_threshold(background.colour, background.noise));
  cv::Mat arriving(images[0].size(), CV_8U, cv::Scalar(0));
  for (std::size_t i = 0; i < images.size(); ++i) {
    cv::Mat leaving(images[0].size(), CV_8U, cv::Scalar(0));
    if (i < flow.size()) leaving = moving_by_flow(flow[i]);
    out.push_back(motion_mask(images[i], test, cv::Mat(leaving | arriving)));
    arriving = leaving;
  }
  return out;
}

double share_of_difference(const std::vector<cv::Mat>& a, const std::vector<cv::Mat>& b) {
  REQUIRE(a.size() == b.size());
  double different = 0, total = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    different += cv::countNonZero(a[i] != b[i]);
    total += double(a[i].total());
  }
  return different / total;
}

// Images with specks, holes, thin lines and content at the border.
std::vector<cv::Mat> difficult_images(cv::Size size, int frames) {
  std::vector<cv::Mat> out = MovingTexture(size, {2, 1}, 2).images(frames);
  cv::RNG random(9);
  for (cv::Mat& image : out) {
    for (int k = 0; k < 40; ++k) {
      const cv::Point at(random.uniform(0, size.width), random.uniform(0, size.height));
      const cv::Scalar colour(random.uniform(0, 256), random.uniform(0, 256), 90);
      const int reach = random.uniform(1, std::max(2, size.height / 6));
      if (k % 4 == 0) cv::line(image, at, {at.x + reach, at.y + 2 * reach}, colour);
      if (k % 4 == 1) cv::circle(image, at, reach, colour, 2);
      if (k % 4 == 2) cv::rectangle(image, cv::Rect(at.x, at.y, reach, reach), colour, -1);
      if (k % 4 == 3) cv::circle(image, at, 1, colour, -1);
    }
  }
  return out;
}

Background background_of(const cv::Mat& colour) {
  return {colour, cv::Mat(colour.size(), CV_8U, cv::Scalar(255)), 1.5};
}

const cv::Size kSizes[] = {{640, 360}, {331, 203}, {97, 65}, {33, 32}, {20, 50}, {7, 5}, {1, 3}};

}  // namespace

TEST_CASE("backgrounds on CUDA are those of the CPU") {
  const auto gpu = on_gpu();
  for (const cv::Size size : kSizes) {
    for (const int frames : {1, 2, 9, 40}) {
      const std::vector<cv::Mat> images = difficult_images(size, frames);
      std::vector<cv::Mat> masks;
      for (int i = 0; i < frames; ++i) {
        masks.emplace_back(size, CV_8U, cv::Scalar(0));
        cv::circle(masks.back(), {3 * i, size.height / 2}, size.height / 4, 255, -1);
        masks.back().at<std::uint8_t>(0, 0) = 255;
      }
      if (frames > 2) masks[2].release();
      const MemoryCapture memory(images, masks);
      for (const bool use_masks : {false, true}) {
        const auto expected = find_background(memory.capture, memory.view, use_masks);
        const auto found = find_gpu_background(*gpu, memory.capture, memory.view, use_masks);
        INFO(size << ", " << frames << " frames, masks " << use_masks << ": "
                  << found.status().message());
        REQUIRE((expected.ok() && found.ok()));
        CHECK(cv::norm(expected->colour, found->colour, cv::NORM_INF) == 0);
        CHECK(cv::norm(expected->valid, found->valid, cv::NORM_INF) == 0);
        CHECK(expected->noise == found->noise);
      }
    }
  }
}

TEST_CASE("masks with given flow on CUDA are those of the CPU") {
  const auto gpu = on_gpu();
  for (const cv::Size size : kSizes) {
    for (const int frames : {1, 2, 4, 5, 11}) {
      const std::vector<cv::Mat> images = difficult_images(size, frames);
      std::vector<cv::Mat> flow;
      for (int i = 0; i + 1 < frames; ++i) {
        flow.emplace_back(size, CV_32FC2, cv::Scalar(0.01, 0));
        cv::rectangle(flow.back(), cv::Rect(0, 0, size.width / 2, size.height), {1.5, -0.5}, -1);
        cv::circle(flow.back(), {size.width / 2, 0}, size.height / 4, cv::Scalar::all(NAN), -1);
      }
      const Background background = background_of(MovingTexture(size, {2, 1}, 2).background());
      const Found found = found_on(*gpu, images, background, flow);
      INFO(size << ", " << frames << " frames");
      // Rounding of the threshold may decide about a pixel.
      CHECK(share_of_difference(found.masks, cpu_masks(images, background, flow)) < 1e-4);
      if (frames > 1) {
        const Found without = found_on(*gpu, images, background, {}, false);
        CHECK(share_of_difference(without.masks, cpu_masks(images, background, {})) < 1e-4);
        CHECK(without.flow[0].empty());
      }
    }
  }
}

TEST_CASE("flow and masks on CUDA are those of the rule") {
  const auto gpu = on_gpu();
  for (const cv::Size size : {cv::Size(640, 360), cv::Size(331, 203), cv::Size(97, 65),
                              cv::Size(33, 32), cv::Size(20, 50)}) {
    const int frames = 6;
    const MovingTexture scene(size, {3, -1}, 1.5);
    const std::vector<cv::Mat> images = scene.images(frames);
    const Background background = background_of(scene.background());
    std::vector<cv::Mat> flow;
    for (int i = 0; i + 1 < frames; ++i) flow.push_back(rule_flow(images[i], images[i + 1], true));
    const Found found = found_on(*gpu, images, background, {});
    INFO(size);
    CHECK(share_of_difference(found.masks, cpu_masks(images, background, flow)) < 0.002);
    CHECK(found.flow.back().empty());
    int known = 0, different = 0;
    for (int i = 0; i + 1 < frames; ++i) {
      for (int y = 0; y < size.height; y += 2) {
        for (int x = 0; x < size.width; x += 2) {
          const cv::Vec2f f = flow[i].at<cv::Vec2f>(y, x);
          const cv::Vec2s g = found.flow[i].at<cv::Vec2s>(y / 2, x / 2);
          const bool masked = found.masks[i].at<std::uint8_t>(y, x) != 0;
          const bool is_known = masked && f[0] == f[0], g_known = g[0] != FlowPatch::kNoFlow;
          known += is_known ? 1 : 0;
          if (is_known && g_known)
            different += cv::norm(cv::Vec2d(g[0], g[1]) / 32 - cv::Vec2d(f[0], f[1])) > 0.05;
          else
            different += is_known != g_known ? 1 : 0;
        }
      }
    }
    // Rounding decides between patches of equal cost.
    CHECK(different <= 0.02 * known);
    CHECK((known > 0) == (std::min(size.width, size.height) >= 32));
  }
}

TEST_CASE("flow of single pairs is that of a sequence") {
  const auto gpu = on_gpu();
  const MovingTexture scene({250, 140}, {2, 2}, 1);
  const std::vector<cv::Mat> images = scene.images(7);
  const Found found = found_on(*gpu, images, background_of(scene.background()), {});
  MemoryCapture memory(images, found.masks);
  ViewMotion motion;
  motion.flow.resize(7);
  motion.has_flow.assign(7, 0);
  for (const int frame : {0, 3, 5}) {
    REQUIRE(find_frame_flow(memory.capture, memory.view, InitSettings(), gpu.get(), frame, &motion)
                .ok());
    REQUIRE(motion.has_flow[frame] == 1);
    const cv::Rect box = motion.flow[frame].box;
    REQUIRE(!box.empty());
    CHECK(cv::norm(motion.flow[frame].vectors, found.flow[frame](box), cv::NORM_INF) == 0);
    cv::Vec2d flow;
    const cv::Point2d centre = scene.centre(frame);
    REQUIRE(motion.flow[frame].at(centre.x, centre.y, &flow));
    CHECK(cv::norm(flow - scene.velocity) < 0.3);
  }
}

TEST_CASE("nothing moves in equal images") {
  const auto gpu = on_gpu();
  const cv::Mat image = MovingTexture({320, 180}, {0, 0}, 0).image(0);
  const Found found = found_on(*gpu, std::vector<cv::Mat>(5, image), background_of(image), {});
  for (const cv::Mat& mask : found.masks) CHECK(cv::countNonZero(mask) == 0);
}

TEST_CASE("cameras at a time have the results of single ones, and of repetitions") {
  const auto gpu = on_gpu();
  const cv::Size sizes[] = {{640, 360}, {200, 112}, {331, 203}};
  std::vector<std::vector<cv::Mat>> images;
  std::vector<Background> backgrounds;
  std::vector<Found> alone;
  for (const cv::Size size : sizes) {
    const MovingTexture scene(size, {3, 1}, 2);
    images.push_back(scene.images(9));
    backgrounds.push_back(background_of(scene.background()));
    alone.push_back(found_on(*gpu, images.back(), backgrounds.back(), {}));
  }
  std::vector<Found> together(24);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < together.size(); ++i)
    threads.emplace_back(
        [&, i] { together[i] = detect(*gpu, images[i % 3], backgrounds[i % 3], {}, true); });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < together.size(); ++i) {
    check_complete(together[i], 9);
    CHECK(share_of_difference(together[i].masks, alone[i % 3].masks) == 0);
    for (std::size_t f = 0; f < 8; ++f)
      CHECK(cv::norm(together[i].flow[f], alone[i % 3].flow[f], cv::NORM_INF) == 0);
  }
}

TEST_CASE("errors of the caller end the detection, and the next one works") {
  const auto gpu = on_gpu();
  const MovingTexture scene({100, 60}, {1, 0}, 1);
  const std::vector<cv::Mat> images = scene.images(6);
  MemoryCapture memory(images, {});
  memory.capture.frames = 7;  // the last is missing
  ViewMotion motion;
  const ProgressSink progress;
  const LogSink log = [](int, const std::string&) {};
  const Work work(progress, log);
  const Status status =
      find_motion(memory.capture, memory.view, InitSettings(), gpu.get(), work, &motion);
  CHECK(!status.ok());
  CHECK(status.message().find("--backend") == std::string::npos);
  memory.capture.frames = 6;
  CHECK(find_motion(memory.capture, memory.view, InitSettings(), gpu.get(), work, &motion).ok());
  CHECK(motion.coverage[3] > 0.02);
}

TEST_CASE("a detection that failed leaves nothing for the next, which needs more memory") {
  const auto gpu = on_gpu();
  const MovingTexture small({64, 48}, {1, 0}, 1), large({640, 360}, {3, 1}, 2);
  std::vector<cv::Mat> broken = small.images(7);
  broken[6].release();
  const std::vector<cv::Mat> images = large.images(5);
  const Background background = background_of(large.background());
  const Found expected = found_on(*on_gpu(), images, background, {});
  CHECK(detect(*gpu, broken, background_of(small.background()), {}, true).status.message() ==
        "no image");
  CHECK(share_of_difference(found_on(*gpu, images, background, {}).masks, expected.masks) == 0);
}

namespace {

double milliseconds(int repeats, const std::function<void()>& task) {
  task();
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < repeats; ++i) task();
  const std::chrono::duration<double, std::milli> passed = std::chrono::steady_clock::now() - start;
  return passed.count() / repeats;
}

}  // namespace

TEST_CASE("times of one camera", "[.times]") {
  const auto gpu = on_gpu();
  for (const auto& [size, frames] : {std::pair{cv::Size(640, 360), 60}, {cv::Size(320, 180), 3}}) {
    const MovingTexture scene(size, {3, 1}, 2);
    const std::vector<cv::Mat> images = scene.images(frames);
    MemoryCapture memory(images, {});
    const Background background = background_of(scene.background());
    const LiveBackground live(background, 100);
    const ProgressSink progress;
    const LogSink log = [](int, const std::string&) {};
    const Work work(progress, log);
    const auto motion_on = [&](MotionFinder* finder) {
      MemoryCapture fresh(images, {});
      ViewMotion motion;
      REQUIRE(find_motion(fresh.capture, fresh.view, InitSettings(), finder, work, &motion).ok());
    };
    std::printf(
        "%dx%d, %d frames: background CPU %.2f ms, CUDA %.2f ms\n", size.width, size.height, frames,
        milliseconds(5, [&] { (void)find_background(memory.capture, memory.view, false); }),
        milliseconds(5,
                     [&] { (void)find_gpu_background(*gpu, memory.capture, memory.view, false); }));
    std::printf("  all: CPU %.2f ms, CUDA %.2f ms\n", milliseconds(2, [&] { motion_on(nullptr); }),
                milliseconds(5, [&] { motion_on(gpu.get()); }));
    std::printf("  masks without flow: CPU %.2f ms, CUDA %.2f ms\n",
                milliseconds(5,
                             [&] {
                               for (const cv::Mat& image : images) (void)live.mask(image);
                             }),
                milliseconds(20, [&] { (void)found_on(*gpu, images, background, {}, false); }));
  }
}
