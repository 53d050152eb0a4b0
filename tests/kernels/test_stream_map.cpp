// SPDX-License-Identifier: Apache-2.0
// Decoded floats do not depend on the vector target or the number of threads.

#include <span>

#include "catch.h"
#include "fixtures/loop_threads.h"
#include "fixtures/scene_fixture.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

std::vector<std::string> decoded(const std::vector<std::uint8_t>& bytes) {
  const auto scene = read_scene(memory_source(bytes));
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  return fingerprints(scene->gaussians);
}

}  // namespace

TEST_CASE("every vector target decodes the same floats") {
  const Scene scene = random_scene(1700, 3, 60, 9);
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    WriteSettings settings;
    settings.profile = profile;
    const auto bytes = encode_scene(scene, settings);
    REQUIRE(bytes.ok());
    const auto expected = decoded(*bytes);
    for_each_vector_target([&] {
      if (decoded(*bytes) != expected) FAIL("the floats differ");
    });
  }
}

TEST_CASE("a segment that several threads decode in chunks round-trips") {
  Scene scene = random_scene(50000, 1, 60, 10);
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < set.size(); ++i) {  // all in one segment, in Morton order
    set.time[i] = 30.0f;
    set.sigma[i] = 200.0f;
    set.opacity_logit[i] = 2.0f;
    set.velocity[3 * i] += 1e-4f * static_cast<float>(i % 1000);
  }
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  std::vector<std::uint32_t> order;
  const auto bytes = encode_scene(scene, settings, &order);
  REQUIRE(bytes.ok());
  const auto read = read_scene(memory_source(*bytes));
  REQUIRE(read.ok());
  const Gaussians4D& got = read->gaussians;
  REQUIRE(got.size() == set.size());
  double position = 0, colour = 0, speed = 0;
  for (std::size_t i = 0; i < got.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const auto error_of = [&](std::span<const float> a, std::span<const float> b,
                                std::size_t stride) {
        return std::abs(double{a[i * stride + c]} - b[order[i] * stride + c]);
      };
      // The position at the middle of the original lifespan, because packing may move T and the
      // position with it.
      const float dt = set.time[order[i]] - got.time[i];
      const double moved = double{got.position[3 * i + c]} + double{dt} * got.velocity[3 * i + c];
      position = std::max(position, std::abs(moved - set.position[3 * order[i] + c]));
      colour = std::max(colour, error_of(got.sh, set.sh, 12));
      speed = std::max(speed, 60.0 * error_of(got.velocity, set.velocity, 3));
    }
  }
  CHECK(position < 0.01);
  CHECK(colour < 0.2);
  CHECK(speed < 0.02);
  const auto all = fingerprints(got);
  const testing::LoopThreads one(1);
  CHECK(decoded(*bytes) == all);
}
