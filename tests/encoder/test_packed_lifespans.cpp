// SPDX-License-Identifier: Apache-2.0
// Lifespans after quantisation: visibility in every frame, and the position of edges.
#include <cmath>
#include <random>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/differences.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

using namespace stgs;
using stgs::testing::random_scene;

namespace {

// A scene before and after packing, primitive by primitive.
struct PackedPair {
  Gaussians4D before, after;
  std::vector<std::uint32_t> order;
};

PackedPair packed(const Scene& scene, double quality) {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.quality = quality;
  PackedPair out;
  auto file = encode_scene(scene, settings, &out.order);
  INFO(file.status().message());
  REQUIRE(file.ok());
  auto read = read_scene(memory_source(std::move(*file)));
  INFO(read.status().message());
  REQUIRE(read.ok());
  out.before = scene.gaussians.gather(out.order);
  out.after = std::move(read->gaussians);
  return out;
}

bool is_visible(const Gaussians4D& set, std::size_t i, double t) {
  const float dt = static_cast<float>(t - set.time[i]);
  return math::opacity_of(set.opacity_logit[i]) *
             math::visibility(dt, set.sigma[i], set.radius[i]) >=
         math::kAlphaThreshold;
}

// Lifespans of an integral number of frames, with edges halfway between two frames.
void make_boxes(Scene& scene, unsigned seed) {
  std::mt19937 random(seed);
  const int frames = static_cast<int>(scene.metadata.frames);
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < set.size(); ++i) {
    const int length = std::uniform_int_distribution(1, i % 2 == 0 ? 6 : frames / 2)(random);
    const int first = std::uniform_int_distribution(0, frames - length)(random);
    set.time[i] = 0.5f * static_cast<float>(2 * first + length - 1);
    set.radius[i] = 0.5f * static_cast<float>(length) - 0.002f;
    set.sigma[i] = 1.0f / 1024.0f;
    set.opacity_logit[i] = std::max(set.opacity_logit[i], -5.0f);
  }
}

}  // namespace

TEST_CASE("primitives with edges between frames are visible in the same frames at any quality") {
  Scene scene = random_scene(1500, 0, 300, 31);
  make_boxes(scene, 32);
  for (const double quality : {0.0, 30.0, 60.0, 85.0, 100.0}) {
    const PackedPair pair = packed(scene, quality);
    REQUIRE(pair.order.size() == scene.gaussians.size());
    int wrong = 0;
    for (std::size_t i = 0; i < pair.order.size(); ++i) {
      for (int t = 0; t <= 300; ++t)
        wrong += is_visible(pair.before, i, t) != is_visible(pair.after, i, t);
    }
    INFO("quality " << quality);
    CHECK(wrong == 0);
  }
}

TEST_CASE("edges between frames are preserved in a part that begins between two frames") {
  Scene scene = random_scene(400, 0, 60, 33);
  make_boxes(scene, 34);
  scene.parts = {{0, 30.25, 150}, {30.25, 60, 250}};
  for (std::size_t i = 0; i < 400; ++i) {
    scene.gaussians.time[i] = 0.5f * scene.gaussians.time[i] + 0.1f;  // no edge falls on a frame
  }
  const PackedPair pair = packed(scene, 60);
  REQUIRE(pair.order.size() > 390);
  int wrong = 0;
  for (std::size_t i = 0; i < pair.order.size(); ++i) {
    const double begin = pair.order[i] < 150 ? 0 : 30.25, end = pair.order[i] < 150 ? 30.25 : 60;
    for (double t = std::ceil(begin); t <= end; ++t) {
      wrong += is_visible(pair.before, i, t - begin) != is_visible(pair.after, i, t - begin);
    }
  }
  CHECK(wrong == 0);
}

TEST_CASE("a distant lifespan does not coarsen the time grid of the others") {
  for (const float distance : {1e5f, 1e8f, 1e30f}) {
    Scene scene = random_scene(300, 0, 90, 35);
    Gaussians4D& set = scene.gaussians;
    set.opacity_logit.assign(300, 2.0f);
    for (std::size_t i = 0; i < 300; ++i) {
      set.time[i] = 5.0f + 80.0f / 300.0f * static_cast<float>(i);
      set.sigma[i] = set.radius[i] = 1.0f;
    }
    set.time[0] = distance;  // never visible
    set.time[1] = 1e5f;      // visible from frame 45
    set.radius[1] = 1e5f - 44.5f;
    set.sigma[1] = 0.01f;
    set.time[2] = -distance;  // always visible
    set.radius[2] = 2.0f * distance;
    for (const std::size_t i : {1, 2}) std::fill_n(&set.velocity[3 * i], 3, 0.0f);
    const PackedPair pair = packed(scene, 85);
    REQUIRE(pair.order.size() == 299);
    for (std::size_t i = 0; i < pair.order.size(); ++i) {
      INFO("distance " << distance << ", primitive " << pair.order[i]);
      if (pair.order[i] > 2) {
        CHECK(std::abs(pair.after.time[i] - pair.before.time[i]) <= 0.126f);
        continue;
      }
      CHECK(is_visible(pair.after, i, 0) == (pair.order[i] == 2));
      CHECK(is_visible(pair.after, i, 45) == is_visible(pair.before, i, 45));
      CHECK(is_visible(pair.after, i, 90));
    }
  }
}

TEST_CASE("visible primitives are never dropped, at any quality") {
  const Scene scene = random_scene(4000, 0, 60, 36);
  std::size_t visible_count = 0;
  for (std::size_t i = 0; i < 4000; ++i) {
    bool ever_visible = false;
    for (int t = 0; t <= 60; ++t) ever_visible |= is_visible(scene.gaussians, i, t);
    visible_count += ever_visible ? 1 : 0;
  }
  for (const double quality : {0.0, 20.0, 34.0, 50.0, 85.0}) {
    INFO("quality " << quality);
    CHECK(packed(scene, quality).order.size() >= visible_count);
  }
}

namespace {

// The larger error, in ticks, of the beginning and end of the flat top, clamped to a part of
// `length` ticks.
double edge_error(const PackedPair& pair, std::size_t i, double length) {
  const auto edge = [&](const Gaussians4D& set, double side) {
    return std::clamp(set.time[i] + side * set.radius[i], 0.0, length);
  };
  return std::max(std::abs(edge(pair.before, -1) - edge(pair.after, -1)),
                  std::abs(edge(pair.before, 1) - edge(pair.after, 1)));
}

// Long lifespans with soft edges that begin and end in or outside a clip of 300 frames.
void make_long_lifespans(Scene& scene, unsigned seed) {
  std::mt19937 random(seed);
  const auto uniform = [&random](float low, float high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.time[i] = uniform(-15.0f, 315.0f);
    set.radius[i] = uniform(20.0f, 120.0f);
    set.sigma[i] = uniform(1.0f, 4.0f);
    set.opacity_logit[i] = 4.0f;
  }
  set.time[0] = 150.0f;
  set.radius[0] = 100.0f;
  set.sigma[0] = 3.0f;
}

}  // namespace

TEST_CASE("long lifespans with soft edges preserve their begin and end") {
  Scene scene = random_scene(2000, 0, 300, 37);
  make_long_lifespans(scene, 38);
  struct Bound {
    double quality, sigmas, ticks, opacity;
  };
  for (const Bound& bound : {Bound{60.0, 0.5, 0.71, 0.7}, Bound{87.0, 0.2, 0.21, 0.3},
                             Bound{100.0, 0.045, 0.05, 0.07}}) {
    const PackedPair pair = packed(scene, bound.quality);
    REQUIRE(pair.order.size() == 2000);
    for (std::size_t i = 0; i < pair.order.size(); ++i) {
      INFO("quality " << bound.quality << ", T " << pair.before.time[i] << ", r "
                      << pair.before.radius[i] << ", sigma " << pair.before.sigma[i]);
      const double bound_ticks = std::max(bound.sigmas * pair.before.sigma[i], bound.ticks);
      REQUIRE(edge_error(pair, i, 300.0) <= bound_ticks);
      const LifespanError error = lifespan_error(pair.before, i, pair.after, i, {0.0, 300.0});
      REQUIRE(error.visibility <= bound.opacity);
      REQUIRE(error.time <= 0.36);
      REQUIRE(error.radius <= bound_ticks + 0.36);
    }
  }
}

TEST_CASE("lifespans that extend far beyond the clip stay visible in the same frames") {
  Scene scene = random_scene(8, 0, 30, 39);
  Gaussians4D& set = scene.gaussians;
  set.time = {-1000, -1000, -60, -5, 1030, -1e5f, -1e8f, -1e5f};
  set.radius = {1003, 1020, 63, 8, 1003, 1e5f + 20, 1.5e8f, 2e5f};
  set.sigma.assign(8, 1.0f);
  set.opacity_logit.assign(8, 2.0f);
  set.velocity.assign(24, 0.0f);
  set.velocity[3 * 7] = 0.5f;       // always visible
  set.position[3 * 7] = -50000.0f;  // at T
  const PackedPair pair = packed(scene, 87);
  REQUIRE(pair.order.size() == 8);
  for (std::size_t i = 0; i < 8; ++i) {
    INFO("T " << pair.before.time[i] << ", r " << pair.before.radius[i]);
    CHECK(edge_error(pair, i, 30.0) <= 0.21);
    CHECK(trajectory_error(pair.before, i, pair.after, i, 30.0) < 0.05);
    int wrong = 0;
    for (int t = 0; t <= 30; ++t)
      wrong += is_visible(pair.before, i, t) != is_visible(pair.after, i, t);
    CHECK(wrong == 0);
  }
}
