// SPDX-License-Identifier: Apache-2.0
// The primitives that are visible at a time, through the C API.
#include <cmath>
#include <limits>

#include "sdk_fixture.h"
#include "stgs/format/interchange.h"
#include "stgs/format/math/blend.h"

namespace stgs::testing {
namespace {

constexpr double kTime = 0.4;  // seconds; 12 ticks of 1/30 s

stgs_primitives no_arrays() {
  stgs_primitives primitives;
  REQUIRE(stgs_primitives_defaults(&primitives, sizeof primitives) == STGS_OK);
  return primitives;
}

// Arrays for `n` primitives of SH degree 1, and the struct that refers to them.
struct Arrays {
  std::vector<std::uint32_t> id;
  std::vector<float> position, velocity, scale, rotation, opacity, sh;

  explicit Arrays(std::size_t n)
      : id(n, 77),
        position(3 * n),
        velocity(3 * n),
        scale(3 * n),
        rotation(4 * n),
        opacity(n, -1),
        sh(12 * n) {}

  stgs_primitives output(std::uint64_t capacity) {
    stgs_primitives out = no_arrays();
    out.capacity = capacity;
    out.id = id.data();
    out.position = position.data();
    out.velocity = velocity.data();
    out.scale = scale.data();
    out.rotation = rotation.data();
    out.opacity = opacity.data();
    out.sh = sh.data();
    return out;
  }
};

std::uint64_t count_of(stgs_scene* scene, double seconds) {
  std::uint64_t count = 0;
  REQUIRE(stgs_scene_get_primitives(scene, seconds, nullptr, &count) == STGS_OK);
  return count;
}

}  // namespace

TEST_CASE("a scene returns the primitives that are visible at the time", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  auto read = read_scene(memory_source(file));
  REQUIRE(read.ok());
  const Gaussians4D& all = read->gaussians;
  auto expected = snapshot_at(*read, 30 * kTime);
  REQUIRE(expected.ok());
  const std::uint64_t count = count_of(scene.get(), kTime);
  REQUIRE(count == expected->size());
  REQUIRE(count > 50);
  REQUIRE(count < all.size());

  Arrays got(count);
  const stgs_primitives output = got.output(count);
  std::uint64_t again = 0;
  REQUIRE(stgs_scene_get_primitives(scene.get(), kTime, &output, &again) == STGS_OK);
  CHECK(again == count);
  float max_error = 0, max_length_error = 0;
  for (std::size_t i = 0; i < count; ++i) {
    REQUIRE(got.id[i] < all.size());
    REQUIRE((i == 0 || got.id[i] > got.id[i - 1]));
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t at = 3 * i + c, stored = std::size_t{3} * got.id[i] + c;
      max_error = std::max(max_error, std::abs(got.position[at] - expected->position[at]));
      max_error = std::max(max_error, std::abs(got.velocity[at] - 30 * all.velocity[stored]));
      max_error = std::max(max_error, std::abs(std::log(got.scale[at]) - all.log_scale[stored]));
    }
    max_error = std::max(max_error,
                         std::abs(got.opacity[i] - math::opacity_of(expected->opacity_logit[i])));
    float length = 0, aligned = 0, stored_length = 0;
    for (std::size_t c = 0; c < 4; ++c) {
      const float stored = all.rotation[4 * got.id[i] + c];
      length += got.rotation[4 * i + c] * got.rotation[4 * i + c];
      aligned += got.rotation[4 * i + c] * stored;
      stored_length += stored * stored;
    }
    max_length_error = std::max(max_length_error, std::abs(length - 1));
    max_error = std::max(max_error, std::abs(aligned / std::sqrt(stored_length) - 1));
  }
  CHECK(max_error < 1e-5f);
  CHECK(max_length_error < 1e-6f);
  CHECK(std::equal(got.sh.begin(), got.sh.end(), expected->sh.begin(), expected->sh.end()));
}

TEST_CASE("primitives beyond the range of float are finite", "[sdk]") {
  Scene scene = random_scene(3, 0, 30, 3);
  for (float& v : scene.gaussians.log_scale) v = 100;  // e^100 is infinite in single precision
  for (float& v : scene.gaussians.velocity) v = 3e38f;
  for (float& v : scene.gaussians.sigma) v = 1000;
  for (float& v : scene.gaussians.opacity_logit) v = 5;
  const auto file = encode_scene(scene, {});
  REQUIRE(file.ok());
  const ScenePtr opened = open_scene(*file);
  const std::uint64_t count = count_of(opened.get(), kTime);
  REQUIRE(count == 3);
  Arrays got(count);
  const stgs_primitives output = got.output(count);
  std::uint64_t again = 0;
  REQUIRE(stgs_scene_get_primitives(opened.get(), kTime, &output, &again) == STGS_OK);
  for (const std::vector<float>* values : {&got.position, &got.velocity, &got.scale}) {
    for (const float v : *values) CHECK(std::isfinite(v));
  }
  CHECK(got.scale[0] == std::numeric_limits<float>::max());
}

TEST_CASE("arrays receive at most as many primitives as their capacity", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const std::uint64_t count = count_of(scene.get(), kTime);
  Arrays full(count), half(count);
  const stgs_primitives all = full.output(count), some = half.output(count / 2);
  std::uint64_t available = 0;
  REQUIRE(stgs_scene_get_primitives(scene.get(), kTime, &all, &available) == STGS_OK);
  REQUIRE(stgs_scene_get_primitives(scene.get(), kTime, &some, &available) == STGS_OK);
  CHECK(available == count);
  CHECK(std::equal(half.position.begin(), half.position.begin() + 3 * (count / 2),
                   full.position.begin()));
  CHECK(half.id[count / 2] == 77);
  CHECK(half.opacity[count / 2] == -1);

  stgs_primitives alone = no_arrays();
  Arrays only(count);
  alone.capacity = count;
  alone.opacity = only.opacity.data();
  REQUIRE(stgs_scene_get_primitives(scene.get(), kTime, &alone, &available) == STGS_OK);
  CHECK(only.opacity == full.opacity);
  CHECK(only.id[0] == 77);
}

TEST_CASE("get_primitives rejects invalid arguments and changes nothing", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file), closed = make_scene();
  std::uint64_t count = 5;
  stgs_primitives primitives = no_arrays();
  CHECK(stgs_scene_get_primitives(nullptr, 0, nullptr, &count) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_scene_get_primitives(closed.get(), 0, nullptr, &count) == STGS_ERROR_STATE);
  CHECK(stgs_scene_get_primitives(scene.get(), 0, nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_scene_get_primitives(scene.get(), std::numeric_limits<double>::quiet_NaN(), nullptr,
                                  &count) == STGS_ERROR_ARGUMENT);
  primitives.struct_size -= 1;
  CHECK(stgs_scene_get_primitives(scene.get(), 0, &primitives, &count) == STGS_ERROR_STRUCT_SIZE);
  CHECK(count == 5);
  CHECK(stgs_primitives_defaults(nullptr, sizeof primitives) == STGS_ERROR_ARGUMENT);
}

}  // namespace stgs::testing
