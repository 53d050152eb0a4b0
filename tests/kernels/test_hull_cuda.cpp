// SPDX-License-Identifier: Apache-2.0
// Compares sweeps in the visual hull on CUDA with the CPU. Exit code 77: no device.
#include <cmath>
#include <thread>

#include "catch.h"
#include "catch_runner.h"
#include "encoder/ball_scene.h"
#include "init/hull_depth.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;
using namespace stgs::testing;

namespace {

constexpr int kWidth = 200;

std::unique_ptr<geometry::HullSweeper> on_gpu() {
  auto sweeper = geometry::make_cuda_hull_sweeper(0);
  INFO(sweeper.status().message());
  REQUIRE(sweeper.ok());
  return std::move(*sweeper);
}

struct Frame {
  std::vector<SweepImage> images;
  std::vector<HullView> wanted;
  DynamicHull hull{silhouettes(9), {0.5, 12}};
};

// A frame in which view 5 is missing, view 6 has no partner and view 7 an empty mask.
Frame frame() {
  Frame out;
  for (int k = 0; k < kViews; ++k) {
    const View view = view_at(k, kWidth);
    out.images.push_back(make_sweep_image(view, image_in(view)));
    if (k == 5) out.images.back() = SweepImage{view, {}, {}, {}, {}, {}};
  }
  for (const int k : {0, 1, 2, 6, 7}) {
    cv::Mat mask = mask_in(view_at(k, kWidth));
    if (k == 7) mask.setTo(0);
    if (k == 1) mask(cv::Rect(0, 0, 9, 9)).setTo(255);  // a second box, which no ray meets
    std::vector<int> partners{(k + 1) % kViews, (k + kViews - 1) % kViews};
    if (k == 6) partners.clear();
    out.wanted.push_back({k, mask, partners});
  }
  out.wanted[2].partners.push_back(4);
  return out;
}

Status sweep_all(const Frame& frame, geometry::HullSweeper* gpu, std::vector<SweptView>* out) {
  const ProgressSink progress;
  const LogSink log = [](int, const std::string&) {};
  const Work work(progress, log);
  return sweep_hull(frame.images, frame.wanted, frame.hull, gpu, work, out);
}

std::vector<SweptView> swept(const Frame& frame, geometry::HullSweeper* gpu) {
  std::vector<SweptView> out;
  const Status status = sweep_all(frame, gpu, &out);
  INFO(status.message());
  REQUIRE(status.ok());
  return out;
}

void check_equal(const SweptView& a, const SweptView& b) {
  REQUIRE(a.map.depth.empty() == b.map.depth.empty());
  CHECK(a.step == Approx(b.step));
  if (a.map.depth.empty()) return;
  int found = 0, depths = 0, costs = 0;
  for (int y = 0; y < a.mask.rows; ++y) {
    for (int x = 0; x < a.mask.cols; ++x) {
      const float d = a.map.depth.at<float>(y, x), e = b.map.depth.at<float>(y, x);
      found += d > 0 ? 1 : 0;
      depths += (d > 0) != (e > 0) || (d > 0 && std::abs(1 / d - 1 / e) > 0.1 * a.step) ? 1 : 0;
      costs += std::abs(a.map.cost.at<float>(y, x) - b.map.cost.at<float>(y, x)) > 0.02 ? 1 : 0;
    }
  }
  CHECK(found > 500);
  // Rounding decides whether a point is inside of a mask, and between paths of equal cost.
  CHECK(depths < found / 50);
  CHECK(costs < found / 50);
}

}  // namespace

TEST_CASE("depths in the hull on CUDA match the CPU") {
  const Frame f = frame();
  const auto gpu = on_gpu();
  const std::vector<SweptView> expected = swept(f, nullptr), found = swept(f, gpu.get());
  REQUIRE(found.size() == expected.size());
  for (std::size_t k = 0; k < found.size(); ++k) {
    INFO("view " << f.wanted[k].view);
    check_equal(expected[k], found[k]);
  }
}

TEST_CASE("depths in the hull are those of the ball") {
  const Frame f = frame();
  const auto gpu = on_gpu();
  const SweptView found = swept(f, gpu.get())[0];
  const View view = view_at(0, kWidth);
  int pixels = 0, close = 0;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const double truth = ball_depth(view, x, y);
      const float depth = found.map.depth.at<float>(y, x);
      if (truth == 0 || depth == 0) continue;
      ++pixels;
      close += std::abs(depth - truth) < 0.05 ? 1 : 0;
    }
  }
  CHECK(pixels > 500);
  CHECK(close > 0.9 * pixels);
}

TEST_CASE("frames that are swept at a time have the depths of single ones") {
  const Frame f = frame();
  const auto gpu = on_gpu();
  const std::vector<SweptView> alone = swept(f, gpu.get());
  constexpr std::size_t kThreads = 7;
  std::vector<std::vector<SweptView>> together(kThreads);
  std::vector<Status> statuses(kThreads);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < kThreads; ++i)
    threads.emplace_back([&, i] { statuses[i] = sweep_all(f, gpu.get(), &together[i]); });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < kThreads; ++i) {
    INFO(statuses[i].message());
    REQUIRE(statuses[i].ok());
    REQUIRE(together[i].size() == alone.size());
    CHECK(cv::norm(together[i][0].map.depth, alone[0].map.depth, cv::NORM_INF) == 0);
  }
}
