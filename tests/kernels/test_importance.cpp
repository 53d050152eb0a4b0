// SPDX-License-Identifier: Apache-2.0
// What a primitive matters to pictures, against what a change of its colour does to them.
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
  slice(set, view.ticks, view.camera, {}, 0, frame);
  bin(frame);
  blend(frame, {}, output);
  return output.colour;
}

// Does where it would weigh what it is told to.
class OddBackend final : public TrainBackend {
 public:
  explicit OddBackend(std::function<Status()> weighs) : weighs_(std::move(weighs)) {}
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
  Result<std::optional<std::vector<float>>> importance(
      std::span<const ImportanceView>, const std::function<bool(double)>&) override {
    return weighs_();
  }
  std::string name() const override { return "odd"; }

 private:
  const std::function<Status()> weighs_;
};

}  // namespace

TEST_CASE("where the backend cannot weigh the CPU does, and where nothing can the scene is kept") {
  TrainState state = train_state(random_scene(50, scene_camera(32, 32), 5, {}), 1);
  const std::vector<ImportanceView> views = importance_scene_views(32, 32);
  std::vector<std::string> told;
  const auto log = [&](int level, const std::string& message) {
    CHECK(level == 1);
    told.push_back(message);
  };
  const auto always = [](double) { return true; };
  OddBackend failing([] { return runtime_error("the GPU is gone"); });
  OddBackend throwing([]() -> Status { throw std::length_error("too many tiles"); });
  const auto cpu = make_cpu_backend();
  CHECK(compute_importance(failing, *cpu, state, views, always, log) ==
        view_importance(state.set, views, always));
  CHECK(told == std::vector<std::string>{"importances could not be computed on the training "
                                         "backend (the GPU is gone); using the CPU"});

  told.clear();
  const auto none = compute_importance(failing, throwing, state, views, always, log);
  REQUIRE(none.has_value());
  CHECK(none->empty());
  REQUIRE(told.size() == 2);
  CHECK(told[1] ==
        "importances could not be computed (too many tiles); pack will use the sizes of the "
        "primitives");

  told.clear();
  CHECK_FALSE(compute_importance(
      *cpu, *cpu, state, views, [](double) { return false; }, log));
  const auto throws = [](double) -> bool { throw std::runtime_error("the window is closed"); };
  CHECK_THROWS_WITH(compute_importance(*cpu, *cpu, state, views, throws, log),
                    "the window is closed");
  CHECK(told.empty());
}

TEST_CASE("importance is what a change of colour does to the pictures") {
  const std::size_t n = 150;
  Gaussians4D set = random_scene(n, scene_camera(96, 64), 5, {0, -2.0f, 0.6f});
  std::fill(set.sh.begin(), set.sh.end(), 0.0f);  // grey: nothing is cut at 0
  const std::vector<ImportanceView> views = importance_scene_views(96, 64);
  const auto importance = view_importance(set, views, [](double) { return true; });
  REQUIRE(importance.has_value());
  REQUIRE(importance->size() == n);
  const float change = 0.25f;
  double wrong = 0, all = 0;
  std::size_t seen = 0;
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
    seen += expected > 0.1;
    wrong += std::pow(expected - (*importance)[i], 2);
    all += expected * expected;
  }
  CHECK(seen > n / 2);
  CHECK(std::sqrt(wrong / all) < 1e-3);
}

TEST_CASE("weighing stops when it is told to, and has told how far it was") {
  const Gaussians4D set = random_scene(50, scene_camera(32, 32), 5, {});
  const std::vector<ImportanceView> views = importance_scene_views(32, 32);
  std::vector<double> told;
  const auto stopped = view_importance(set, views, [&](double done) {
    told.push_back(done);
    return told.size() < 3;
  });
  CHECK_FALSE(stopped.has_value());
  REQUIRE(told.size() == 3);
  CHECK(told[0] == 0.0);
  CHECK(told[2] == Approx(2.0 / static_cast<double>(views.size())));
}

TEST_CASE("views for weighing are of the training cameras and of all frames, at half size") {
  PreparedCapture capture;
  capture.frames = 10;
  capture.cameras.resize(3);
  for (std::size_t c = 0; c < 3; ++c) {
    capture.cameras[c].width = 101 + 100 * static_cast<int>(c);
    capture.cameras[c].height = 60;
  }
  capture.cameras[1].test = true;
  const std::vector<ImportanceView> views = importance_views(capture, 40);
  REQUIRE(views.size() == 40);
  std::set<float> moments, widths;
  for (const ImportanceView& view : views) {
    moments.insert(view.ticks);
    widths.insert(view.camera.width);
    CHECK(view.camera.height == 30.0f);
  }
  CHECK(moments.size() == 10);
  CHECK(*moments.begin() == 0.0f);
  CHECK(*moments.rbegin() == 9.0f);
  CHECK(widths == std::set<float>{50.0f, 150.0f});

  for (Camera& camera : capture.cameras) camera.test = true;
  CHECK(importance_views(capture, 40).empty());
}
