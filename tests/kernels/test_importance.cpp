// SPDX-License-Identifier: Apache-2.0
// Compares importances with the effect of a change of colour on the rendered images.
#include "train/importance.h"

#include <cmath>
#include <set>

#include "catch.h"
#include "importance_scene.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/raster.h"
#include "train/compute_importance.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

Image red_of(const Gaussians4D& set, const ImportanceView& view) {
  SplatFrame frame;
  RasterOutput output;
  begin_frame(view.camera, frame);
  RasterSettings settings;
  settings.kernel = view.kernel;
  slice(set, view.ticks, view.camera, settings, 0, frame);
  bin(frame);
  blend(frame, {}, output);
  return output.colour;
}

// A backend whose importance() runs the given action.
class FakeBackend final : public TrainBackend {
 public:
  explicit FakeBackend(std::function<Status()> action) : action_(std::move(action)) {}
  Status join(Ranks&) override { return {}; }
  Status check_perceptual() const override { return {}; }
  Status reserve(const TrainPlan&) override { return {}; }
  Status begin(TrainState&) override { return {}; }
  Status step(const StepInput&) override { return {}; }
  Result<DensifyCounts> densify(const DensifyInput&) override { return DensifyCounts(); }
  std::size_t size() const override { return 0; }
  Result<std::vector<StepOutput>> read() override { return std::vector<StepOutput>(); }
  Status synchronise() override { return {}; }
  std::size_t abandon() override { return 0; }
  Status limit_scales(std::span<const math::PinholeCamera>, float) override { return {}; }
  Result<std::optional<std::vector<float>>> importance(
      std::span<const ImportanceView>, const std::function<bool(double)>&) override {
    return action_();
  }
  std::string name() const override { return "fake"; }

 private:
  const std::function<Status()> action_;
};

}  // namespace

TEST_CASE(
    "compute_importance falls back to the CPU, and returns no importances if that fails too") {
  TrainState state = train_state(random_scene(50, scene_camera(32, 32), 5, {}), 1);
  const std::vector<ImportanceView> views = importance_scene_views(32, 32);
  std::vector<std::string> logged;
  const auto log = [&](int level, const std::string& message) {
    CHECK(level == 1);
    logged.push_back(message);
  };
  const auto always = [](double) { return true; };
  FakeBackend failing([] { return runtime_error("the GPU is gone"); });
  FakeBackend throwing([]() -> Status { throw std::length_error("too many tiles"); });
  const auto cpu = make_cpu_backend();
  CHECK(compute_importance(failing, *cpu, state, views, always, log) ==
        view_importance(state.set, views, always));
  CHECK(logged == std::vector<std::string>{"importances could not be computed on the training "
                                           "backend (the GPU is gone); using the CPU"});

  logged.clear();
  const auto none = compute_importance(failing, throwing, state, views, always, log);
  REQUIRE(none.has_value());
  CHECK(none->empty());
  REQUIRE(logged.size() == 2);
  CHECK(logged[1] ==
        "importances could not be computed (too many tiles); pack will use the sizes of the "
        "primitives");

  logged.clear();
  CHECK_FALSE(compute_importance(
      *cpu, *cpu, state, views, [](double) { return false; }, log));
  const auto throws = [](double) -> bool { throw std::runtime_error("the window is closed"); };
  CHECK_THROWS_WITH(compute_importance(*cpu, *cpu, state, views, throws, log),
                    "the window is closed");
  CHECK(logged.empty());
}

TEST_CASE("importance is the effect of a change of colour on the images") {
  const std::size_t n = 150;
  Gaussians4D set = random_scene(n, scene_camera(96, 64), 5, {0, -2.0f, 0.6f});
  std::fill(set.sh.begin(), set.sh.end(), 0.0f);  // grey, so that no colour is clamped at 0
  const std::vector<ImportanceView> views = importance_scene_views(96, 64);
  const auto importance = view_importance(set, views, [](double) { return true; });
  REQUIRE(importance.has_value());
  REQUIRE(importance->size() == n);
  const float change = 0.25f;
  double error = 0, all = 0;
  std::size_t visible = 0;
  for (std::size_t i = 0; i < n; ++i) {
    Gaussians4D changed = set;
    changed.sh[3 * i] += change;
    double square = 0;
    for (const ImportanceView& view : views) {
      const Image before = red_of(set, view), after = red_of(changed, view);
      const std::size_t pixels = std::size_t{1} * before.width * before.height;
      for (std::size_t p = 0; p < pixels; ++p) {
        const double d = double{after.plane(0)[p]} - before.plane(0)[p];
        square += d * d;
      }
    }
    const float by_colour = change * math::sh_basis({0, 0, 1}).v[0];
    const double expected = square / (double{by_colour} * by_colour);
    visible += expected > 0.1;
    error += std::pow(expected - (*importance)[i], 2);
    all += expected * expected;
  }
  CHECK(visible > n / 2);
  CHECK(std::sqrt(error / all) < 1e-3);
}

TEST_CASE("computing importances reports its progress and can be stopped") {
  const Gaussians4D set = random_scene(50, scene_camera(32, 32), 5, {});
  const std::vector<ImportanceView> views = importance_scene_views(32, 32);
  std::vector<double> progress;
  const auto stopped = view_importance(set, views, [&](double done) {
    progress.push_back(done);
    return progress.size() < 3;
  });
  CHECK_FALSE(stopped.has_value());
  REQUIRE(progress.size() == 3);
  CHECK(progress[0] == 0.0);
  CHECK(progress[2] == Approx(2.0 / static_cast<double>(views.size())));
}

TEST_CASE("importance views use the training cameras, all frames and half size") {
  PreparedCapture capture;
  capture.frames = 10;
  capture.cameras.resize(3);
  for (std::size_t c = 0; c < 3; ++c) {
    capture.cameras[c].width = 101 + 100 * static_cast<int>(c);
    capture.cameras[c].height = 60;
  }
  capture.cameras[1].test = true;
  const std::vector<ImportanceView> views = importance_views(capture, 40, math::kBandLimited);
  REQUIRE(views.size() == 40);
  std::set<float> times, widths;
  for (const ImportanceView& view : views) {
    times.insert(view.ticks);
    widths.insert(view.camera.width);
    CHECK(view.camera.height == 30.0f);
    CHECK(view.kernel == math::kBandLimited);
  }
  CHECK(times.size() == 10);
  CHECK(*times.begin() == 0.0f);
  CHECK(*times.rbegin() == 9.0f);
  CHECK(widths == std::set<float>{50.0f, 150.0f});

  for (Camera& camera : capture.cameras) camera.test = true;
  CHECK(importance_views(capture, 40, math::kBandLimited).empty());
}
