// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cmath>

#include "catch.h"
#include "stgs/format/scene_statistics.h"

using namespace stgs;

namespace {

struct Primitive {
  float x, opacity, sigma, radius, time, speed;  // scene units, ticks; speed along y
};

Scene scene_of(const std::vector<Primitive>& primitives, std::uint32_t frames) {
  Scene scene;
  scene.metadata.time_base = {1, 10};
  scene.metadata.frames = frames;
  Gaussians4D& set = scene.gaussians;
  set.resize(primitives.size());
  for (std::size_t i = 0; i < primitives.size(); ++i) {
    const Primitive& p = primitives[i];
    set.position[3 * i] = p.x;
    set.opacity_logit[i] = std::log(p.opacity / (1 - p.opacity));
    set.sigma[i] = p.sigma;
    set.radius[i] = p.radius;
    set.time[i] = p.time;
    set.velocity[3 * i + 1] = p.speed;
  }
  return scene;
}

std::uint64_t sum(const std::vector<HistogramBin>& bins) {
  std::uint64_t total = 0;
  for (const HistogramBin& bin : bins) total += bin.count;
  return total;
}

const HistogramBin& bin_of(const std::vector<HistogramBin>& bins, double value) {
  for (const HistogramBin& bin : bins) {
    if (value >= bin.from && value < bin.to) return bin;
  }
  FAIL("no bin for " << value);
  return bins.front();
}

}  // namespace

TEST_CASE("lifespans, speeds and the static share follow their definitions") {
  // Twenty frames of 0.1 s. An opacity of e / 255 gives a support half width of r + sigma.
  const float o = std::exp(1.0f) / 255.0f;
  std::vector<Primitive> primitives = {
      {0.0f, o, 5.0f, 10.0f, 9.5f, 0.0f},     // covers frames 0 to 19 and is static
      {0.0f, o, 5.0f, 10.0f, 9.5f, 2e-2f},    // covers them and drifts by 0.38 units
      {0.0f, o, 5.0f, 10.0f, 19.0f, 0.0f},    // lasts 3 s and is cut by the end
      {0.0f, o, 1.0f, 2.0f, 4.0f, 0.5f},      // lasts 0.6 s at 5 units per second
      {0.0f, 1e-3f, 5.0f, 10.0f, 9.5f, 9.0f}  // never visible
  };
  for (int i = 0; i < 95; ++i) {
    // Short-lived and static, in a row from -1 to 1, which sets the scene radius.
    primitives.push_back({static_cast<float>(i - 47) / 47.0f, o, 0.2f, 0.0f, 4.0f, 0.0f});
  }
  const SceneStatistics s = scene_statistics(scene_of(primitives, 20));
  CHECK(s.primitives == 100);
  CHECK(s.never_visible == 1);
  CHECK(s.clip_seconds == Approx(2.0));
  CHECK(s.scene_radius == Approx(0.95).margin(0.05));
  CHECK(s.static_bound == Approx(1e-3 * s.scene_radius));
  CHECK(s.whole_clip == 2);
  CHECK(s.static_primitives == 1);
  CHECK(s.static_share() == Approx(1.0 / 99));
  CHECK(s.whole_clip_drift == Approx(0.19));
  CHECK(s.median_lifespan == Approx(0.04));
  CHECK(sum(s.lifespans) == 97);
  CHECK(bin_of(s.lifespans, 3.0).count == 1);
  CHECK(std::isinf(bin_of(s.lifespans, 3.0).to));
  CHECK(bin_of(s.lifespans, 0.6).count == 1);
  CHECK(bin_of(s.lifespans, 0.04).count == 95);
  CHECK(s.lifespans.back().from == Approx(2.0));
  for (std::size_t i = 1; i + 1 < s.lifespans.size(); ++i) {
    CHECK(s.lifespans[i].to == Approx(2 * s.lifespans[i].from));
  }
  CHECK(sum(s.speeds) == 99);
  CHECK(bin_of(s.speeds, 5.0).count == 1);
  CHECK(bin_of(s.speeds, 0.2).count == 1);
  CHECK(bin_of(s.speeds, 0.0).count == 97);
  CHECK(s.median_speed == 0.0);
}

TEST_CASE("an empty scene has valid statistics") {
  const SceneStatistics s = scene_statistics(scene_of({}, 1));
  CHECK(s.primitives == 0);
  CHECK(s.static_share() == 0.0);
  CHECK(sum(s.lifespans) == 0);
}

TEST_CASE("the frames of primitives take logarithmic time in the number of parts") {
  constexpr std::uint32_t kParts = 300000;  // a search through all parts takes minutes
  Scene scene = scene_of(std::vector<Primitive>(kParts, {0, 0.9f, 1, 1, 0, 0}), kParts);
  for (std::uint32_t i = 0; i < kParts; ++i) {
    ScenePart part;
    part.primitives = 1;
    part.begin_ticks = i;
    part.end_ticks = i + 1;
    scene.parts.push_back(part);
  }
  const auto begin = std::chrono::steady_clock::now();
  CHECK(scene_statistics(scene).whole_clip == kParts);
  CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(20));
  const ShownFrameTable table(scene);
  CHECK(table.frames(12345).first == 12345);
  CHECK(table.frames(12345).last == 12345);
  CHECK(table.frames(kParts - 1).part_begin == kParts - 1);
}
