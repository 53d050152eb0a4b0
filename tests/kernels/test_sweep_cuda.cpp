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

void check_equal(const DepthMap& a, const DepthMap& b, double step) {
  REQUIRE(a.depth.size() == b.depth.size());
  int depths = 0, costs = 0;
  for (int y = 0; y < a.depth.rows; ++y) {
    for (int x = 0; x < a.depth.cols; ++x) {
      const float d = a.depth.at<float>(y, x), e = b.depth.at<float>(y, x);
      depths += (d > 0) != (e > 0) || (d > 0 && std::abs(1 / d - 1 / e) > 0.1 * step) ? 1 : 0;
      // Costs have 254 levels.
      costs += std::abs(a.cost.at<float>(y, x) - b.cost.at<float>(y, x)) > 1.5 / 254 ? 1 : 0;
    }
  }
  const int pixels = int(a.depth.total());
  std::printf("%dx%d: depth differs in %.3f %% of the pixels, cost in %.3f %%\n", a.depth.cols,
              a.depth.rows, 100.0 * depths / pixels, 100.0 * costs / pixels);
  // Equal to the bit, except on a CPU without fused multiply-add (geometry/sweep_cost.h).
  CHECK(depths < pixels / 500);
  CHECK(costs < pixels / 500);
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
      check_equal(expected[k], found[k], plane_step(wanted[k].planes));
    }
    CHECK(cv::countNonZero(found[3].depth) == 0);
  }
}

TEST_CASE("depth maps of views on CUDA are as accurate as on the CPU") {
  const auto gpu = on_gpu();
  const std::vector<SweepImage> images = images_of(200);
  const WantedDepth wanted{0, {1, 9}, {3, 11, 96}};
  const View& view = images[0].view;
  const auto share_of_close = [&](const DepthMap& map) {
    int close = 0;
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const double difference = 1 / true_depth(view, x, y) - 1 / map.depth.at<float>(y, x);
        close += std::abs(difference) < 2 * plane_step(wanted.planes) ? 1 : 0;
      }
    }
    return double(close) / double(map.depth.total());
  };
  const double expected = share_of_close(swept(images, {wanted}, nullptr)[0]);
  REQUIRE(expected > 0.65);
  CHECK(share_of_close(swept(images, {wanted}, gpu.get())[0]) > expected - 0.01);
}

TEST_CASE("sweeps in several batches and from several threads have the depths of single ones") {
  const auto gpu = on_gpu();
  const std::vector<SweepImage> images = images_of(200);
  const WantedDepth one{0, {1, 9, 2}, {2, 12, 128}};
  const DepthMap alone = swept(images, {one}, gpu.get())[0];
  const std::vector<WantedDepth> many(40, one);  // the volumes exceed a batch
  std::vector<std::vector<DepthMap>> together(3);
  std::vector<std::thread> threads;
  for (auto& out : together)
    threads.emplace_back([&] { (void)sweep_all(images, many, gpu.get(), &out); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& maps : together) {
    REQUIRE(maps.size() == many.size());
    for (const DepthMap& map : maps) {
      CHECK(cv::norm(map.depth, alone.depth, cv::NORM_INF) == 0);
      CHECK(cv::norm(map.cost, alone.cost, cv::NORM_INF) == 0);
    }
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
