// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <memory>
#include <vector>

#include "backend/backend.h"
#include "catch.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

TEST_CASE("scales are limited in the image that samples a primitive most densely") {
  // Two cameras on the axis; the second one is twice as far from the origin.
  std::vector<math::PinholeCamera> cameras(2);
  for (int k = 0; k < 2; ++k) {
    cameras[k].rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    cameras[k].translation = {0, 0, 2.0f * static_cast<float>(k + 1)};
    cameras[k].fx = 100;
    cameras[k].fy = 90;
    cameras[k].cx = cameras[k].cy = 50;
    cameras[k].width = cameras[k].height = 100;
    cameras[k].near_plane = 0.1f;
  }
  Gaussians4D set = random_scene(4, scene_camera(32, 32), 5, {});
  const float positions[4][3] = {{0, 0, 0},     // 2 units in front of the first camera
                                 {1.5f, 0, 0},  // only in the second image
                                 {0, 0, -10},   // behind both
                                 {0, 0, 0}};
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      set.position[3 * i + k] = positions[i][k];
      set.log_scale[3 * i + k] = i == 3 ? std::log(0.5f) : std::log(0.001f);
    }
    set.log_scale[3 * i] = std::log(0.3f);
  }
  TrainState state = train_state(set, 1);
  const std::unique_ptr<TrainBackend> backend = make_cpu_backend();
  REQUIRE(backend->begin(state).ok());
  REQUIRE(backend->limit_scales(cameras, 0.5f).ok());
  REQUIRE(backend->synchronise().ok());
  const auto scale = [&](std::size_t i, std::size_t k) {
    return std::exp(state.set.log_scale[3 * i + k]);
  };
  CHECK(scale(0, 0) == Approx(0.3f));
  CHECK(scale(0, 1) == Approx(0.5f * 2 / 100));
  CHECK(scale(0, 2) == Approx(0.5f * 2 / 100));
  CHECK(scale(1, 1) == Approx(0.5f * 4 / 100));
  CHECK(scale(2, 1) == Approx(0.001f));
  CHECK(scale(3, 2) == Approx(0.5f));
}
