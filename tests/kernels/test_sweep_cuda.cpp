// SPDX-License-Identifier: Apache-2.0
// Compares plane sweeps of whole views on CUDA with the CPU, and prints the time of both. Exit code
// 77: no device.
#include <chrono>
#include <cmath>
#include <thread>

#include "catch.h"
#include "catch_runner.h"
#include "encoder/ball_scene.h"
#include "init/depth_sweep.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;
using namespace stgs::testing;

namespace {

constexpr double kRoom = 6;  // radius of the textured sphere around the ball

std::unique_ptr<geometry::ViewSweeper> on_gpu() {
  auto sweeper = geometry::make_cuda_view_sweeper(0);
  INFO(sweeper.status().message());
  REQUIRE(sweeper.ok());
  CHECK((*sweeper)->name().substr(0, 6) == "cuda (");
  return std::move(*sweeper);
}

// The depth of the ball or, behind it, of the room.
double true_depth(const View& view, int x, int y) {
  if (const double ball = ball_depth(view, x, y); ball > 0) return ball;
  const cv::Vec3d ray = view.ray(x + 0.5, y + 0.5);
  const double a = ray.dot(ray), b = ray.dot(view.centre);
  return (-b + std::sqrt(b * b - a * (view.centre.dot(view.centre) - kRoom * kRoom))) / a;
}

SweepImage image_at(int k, int width, bool with_unusable) {
  const View view = view_at(k, width);
  cv::Mat image(view.size(), CV_8UC3), usable;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const cv::Vec3d p = view.at(x + 0.5, y + 0.5, true_depth(view, x, y));
      double value = 128;
      for (int f = 1; f <= 3; ++f) {
        value += 50.0 / f * std::sin(5 * f * p[0] + f) * std::cos(5 * f * p[1] + 2 * f) +
                 40.0 / f * std::sin(5 * f * p[2] + 3 * f);
      }
      image.at<cv::Vec3b>(y, x) = cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(value));
    }
  }
  if (with_unusable) {
    usable = cv::Mat(view.size(), CV_8U, cv::Scalar(255));
    usable(cv::Rect(view.width / 3, view.height / 4, view.width / 5, view.height / 2)).setTo(0);
  }
  return make_sweep_image(view, image, usable);
}

// Every second image has unusable pixels.
std::vector<SweepImage> images_of(int width) {
  std::vector<SweepImage> out;
  for (int k = 0; k < kViews; ++k) out.push_back(image_at(k, width, k % 2 == 1));
  return out;
}

Status sweep_all(const std::vector<SweepImage>& images, const std::vector<WantedDepth>& wanted,
                 geometry::ViewSweeper* gpu, std::vector<DepthMap>* out) {
  const ProgressSink progress;
  const LogSink log;
  Work work(progress, log);
  work.stage("depth");
  return sweep_views(images, wanted, gpu, work, out);
}

std::vector<DepthMap> swept(const std::vector<SweepImage>& images,
                            const std::vector<WantedDepth>& wanted, geometry::ViewSweeper* gpu) {
  std::vector<DepthMap> out;
  const Status status = sweep_all(images, wanted, gpu, &out);
  INFO(status.message());
  REQUIRE(status.ok());
  REQUIRE(out.size() == wanted.size());
  return out;
}

// Equal to the bit, because CPUs next to a GPU have fused multiply-add (geometry/sweep_cost.h).
bool are_equal(const DepthMap& a, const DepthMap& b) {
  return a.depth.size() == b.depth.size() && cv::norm(a.depth, b.depth, cv::NORM_INF) == 0 &&
         cv::norm(a.cost, b.cost, cv::NORM_INF) == 0;
}

template <typename Task>
double milliseconds(const Task& task) {
  const auto start = std::chrono::steady_clock::now();
  task();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

}  // namespace

TEST_CASE("depth maps of views on CUDA match the CPU") {
  const auto gpu = on_gpu();
  // With 1 to 3 sources, in the tiles of the kernels and beyond, and view 3 without a source.
  const std::vector<WantedDepth> wanted{{0, {1, 9, 2}, {2, 12, 64}},  {1, {0}, {2, 12, 96}},
                                        {2, {1, 3}, {3, 11, 33}},     {3, {}, {2, 12, 64}},
                                        {4, {5, 3, 6}, {2, 12, 128}}, {9, {0, 8}, {3, 4, 2}}};
  for (const int width : {64, 75, 200}) {
    const std::vector<SweepImage> images = images_of(width);
    const std::vector<DepthMap> expected = swept(images, wanted, nullptr);
    const std::vector<DepthMap> found = swept(images, wanted, gpu.get());
    for (std::size_t k = 0; k < wanted.size(); ++k) {
      INFO("width " << width << ", view " << wanted[k].view);
      CHECK(are_equal(expected[k], found[k]));
    }
    CHECK(cv::countNonZero(found[3].depth) == 0);
  }
}

TEST_CASE("depth maps of views on CUDA are accurate") {
  const std::vector<SweepImage> images = images_of(200);
  const WantedDepth wanted{0, {1, 9}, {3, 11, 96}};
  const DepthMap map = swept(images, {wanted}, on_gpu().get())[0];
  const View& view = images[0].view;
  int close = 0;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const double difference = 1 / true_depth(view, x, y) - 1 / map.depth.at<float>(y, x);
      close += std::abs(difference) < 2 * plane_step(wanted.planes) ? 1 : 0;
    }
  }
  CHECK(close > 0.65 * double(map.depth.total()));
}

TEST_CASE("sweeps in several problems and from several threads have the depths of single ones") {
  const auto gpu = on_gpu();
  const std::vector<SweepImage> images = images_of(200);
  const WantedDepth one{0, {1, 9, 2}, {2, 12, 128}};
  const DepthMap alone = swept(images, {one}, gpu.get())[0];
  const std::vector<WantedDepth> many(40, one);  // the volumes exceed a problem
  constexpr std::size_t kThreads = 3;
  std::vector<std::vector<DepthMap>> together(kThreads);
  std::vector<Status> statuses(kThreads);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < kThreads; ++i)
    threads.emplace_back(
        [&, i] { statuses[i] = sweep_all(images, many, gpu.get(), &together[i]); });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < kThreads; ++i) {
    INFO(statuses[i].message());
    REQUIRE(statuses[i].ok());
    REQUIRE(together[i].size() == many.size());
    for (const DepthMap& map : together[i]) CHECK(are_equal(map, alone));
  }
}

TEST_CASE("times of sweeps") {
  const auto gpu = on_gpu();
  for (const int width : {128, 320}) {
    const std::vector<SweepImage> images = images_of(width);
    std::vector<WantedDepth> wanted;
    for (int k = 0; k < 27; ++k)
      wanted.push_back({k % kViews,
                        {(k + 1) % kViews, (k + 9) % kViews, (k + 2) % kViews},
                        {2, 12, width < 200 ? 64 : 96}});
    swept(images, wanted, gpu.get());
    const double cpu_time = milliseconds([&] { swept(images, wanted, nullptr); });
    const double gpu_time = milliseconds([&] { swept(images, wanted, gpu.get()); });
    std::printf("27 views %d pixels wide: CPU %.1f ms, CUDA %.2f ms\n", width, cpu_time, gpu_time);
  }
}
