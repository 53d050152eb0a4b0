// SPDX-License-Identifier: Apache-2.0
// The problems that a GPU gets for plane sweeps of whole views.
#include <functional>

#include "ball_scene.h"
#include "catch.h"
#include "init/depth_sweep.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;
using namespace stgs::testing;

namespace {

// Stands for a GPU: depths are the grey level of the reference, costs that of the first source.
class FakeGpu final : public geometry::ViewSweeper {
 public:
  std::string name() const override { return "fake"; }
  Status run(const geometry::ViewSweeps& problem) override {
    ++problems;
    std::size_t volume = 0;
    for (const geometry::ViewSweep& sweep : problem.sweeps) {
      const geometry::SweepSource& reference = problem.images[sweep.reference];
      const int pixels = reference.width * reference.height;
      volume += std::size_t(pixels) * std::size_t(sweep.planes);
      std::fill_n(sweep.depth, pixels, float(reference.corners[0] & 255));
      std::fill_n(sweep.cost, pixels,
                  float(problem.images[sweep.sources[0].image].corners[0] & 255));
    }
    exceeded = exceeded || (problem.sweeps.size() > 1 && volume > geometry::kMaxSweepVolume);
    if (after_run) after_run();
    return {};
  }

  std::function<void()> after_run;
  int problems = 0;
  bool exceeded = false;  // whether a problem was larger than the limit
};

// Images of which each has one grey level.
std::vector<SweepImage> grey_images() {
  std::vector<SweepImage> out;
  for (int k = 0; k < kViews; ++k) {
    const View view = view_at(k);
    out.push_back(make_sweep_image(view, cv::Mat(view.size(), CV_8UC3, cv::Scalar::all(10 + k))));
  }
  return out;
}

// Each view against the next, with as many planes; view 3 without a source.
std::vector<WantedDepth> each_view(int planes) {
  std::vector<WantedDepth> out;
  for (int k = 0; k < kViews; ++k) out.push_back({k, {(k + 1) % kViews}, {2, 12, planes}});
  out[3].others.clear();
  return out;
}

}  // namespace

TEST_CASE("a GPU gets sweeps within the limit, and its depths are those of their views") {
  const ProgressSink progress;
  const LogSink log;
  Work work(progress, log);
  work.stage("depth");
  const std::vector<SweepImage> images = grey_images();
  FakeGpu gpu;
  std::vector<DepthMap> out;
  // 320 x 240 pixels: 6 sweeps of 128 planes are a problem.
  REQUIRE(sweep_views(images, each_view(128), &gpu, work, &out).ok());
  CHECK(gpu.problems == 2);
  CHECK(!gpu.exceeded);
  REQUIRE(out.size() == kViews);
  for (int k = 0; k < kViews; ++k) {
    const float depth = k == 3 ? 0.0f : float(10 + k);
    const float cost = k == 3 ? 1.0f : float(10 + (k + 1) % kViews);
    CHECK(cv::norm(out[k].depth, cv::Mat(out[k].depth.size(), CV_32F, depth), cv::NORM_INF) == 0);
    CHECK(cv::norm(out[k].cost, cv::Mat(out[k].cost.size(), CV_32F, cost), cv::NORM_INF) == 0);
  }
}

TEST_CASE("sweeps on a GPU are cancelled between problems") {
  const ProgressSink progress;
  const LogSink log;
  Work work(progress, log);
  work.stage("depth");
  FakeGpu gpu;
  gpu.after_run = [&] { work.cancel(); };
  std::vector<DepthMap> out;
  const Status status = sweep_views(grey_images(), each_view(128), &gpu, work, &out);
  CHECK(status.message() == "depth: cancelled");
  CHECK(gpu.problems == 1);
}
