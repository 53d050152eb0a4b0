// SPDX-License-Identifier: Apache-2.0
// Which primitives of a training window persist, and as what.
#include "train/persistence.h"

#include <algorithm>

#include "catch.h"
#include "random_train_state.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

// A primitive that is static and visible in frames 0 to 9.
TrainState static_state(std::size_t n) {
  TrainState state = testing::random_train_state(n, 3);
  std::fill(state.velocity.begin(), state.velocity.end(), 0.0f);
  std::fill(state.set.radius.begin(), state.set.radius.end(), 20.0f);
  std::fill(state.set.time.begin(), state.set.time.end(), 4.5f);
  std::fill(state.updates.begin(), state.updates.end(), 100);
  state.derive_all(true);
  state.iteration = 1000;
  return state;
}

}  // namespace

TEST_CASE("static content of a window persists if it was seen enough") {
  using Indices = std::vector<std::uint32_t>;
  TrainState state = static_state(7);
  CHECK(list_persistent(state, 10) == Indices{0, 1, 2, 3, 4, 5, 6});
  state.set.velocity[3 * 1] = 1.0f;  // moves by several of its sizes
  state.set.radius[2] = 0.5f;        // fades
  state.set.sigma[2] = 1.0f;
  state.updates[3] = 2;  // hardly seen
  state.set.time[4] = 60.0f;
  state.updates[5] = kFixed;  // however it moves
  state.set.velocity[3 * 5] = 1.0f;
  CHECK(list_persistent(state, 10) == Indices{0, 5, 6});
}

TEST_CASE("a persistent primitive looks as it did, at all times") {
  TrainState state = static_state(1);
  state.set.radius[0] = 3.0f;
  state.set.sigma[0] = 4.0f;
  state.set.time[0] = 4.0f;
  state.set.velocity[1] = 0.01f;
  const float y = state.set.position[1] + 0.01f * 0.5f;  // in the middle, frame 4.5
  double mean = 0;
  for (int f = 0; f < 10; ++f) {
    mean += math::opacity_of(state.set.opacity_logit[0]) *
            math::visibility(static_cast<float>(f) - 4.0f, 4.0f, 3.0f) / 10;
  }
  persist(state, 0, 0, 10);
  CHECK(state.set.position[1] == Approx(y));
  CHECK(state.set.velocity[1] == 0.0f);
  CHECK(math::opacity_of(state.set.opacity_logit[0]) == Approx(mean).epsilon(1e-4));
  for (const float t : {0.0f, 9.0f, 1e6f})
    CHECK(math::visibility(t - state.set.time[0], state.set.sigma[0], state.set.radius[0]) == 1.0f);
}

TEST_CASE("candidates join the persistent set unchanged, with colours and without moments") {
  TrainState state = static_state(4);
  state.updates[1] = kFixed;
  state.colour[0][3] = 0.25f;
  state.moments[kOpacity].first[2] = 1.0f;
  const TrainState kept = persistent_state(state, {1, 2}, {}, {}, 10);
  REQUIRE(kept.size() == 2);
  CHECK(kept.is_fixed(0));
  CHECK(kept.updates[1] == 0);
  CHECK(kept.moments[kOpacity].first[1] == 0.0f);
  CHECK(kept.colour == state.colour);
  CHECK(kept.set.position[3] == state.set.position[6]);
  CHECK(persistent_state(state, {1, 2}, {}, {2}, 10).count_fixed() == 2);
}

TEST_CASE("moving content of the last frame continues in the next window") {
  using Indices = std::vector<std::uint32_t>;
  TrainState state = static_state(5);
  std::fill(state.set.opacity_logit.begin(), state.set.opacity_logit.end(), 2.0f);
  state.updates[1] = kFixed;
  state.set.opacity_logit[2] = -5.0f;  // hardly visible
  state.set.time[3] = -20.0f;          // visible at the beginning alone
  state.set.radius[3] = 22.0f;
  state.set.sigma[3] = 1.0f;
  state.set.velocity[3 * 4 + 1] = 0.25f;
  state.set.time[4] = 6.0f;
  CHECK(list_carried(state, 10, {0}) == Indices{4});
  const float y = state.set.position[3 * 4 + 1] + 4 * 0.25f;  // from frame 6 to the next window
  const TrainState next = persistent_state(state, {0, 1}, {4}, {0}, 10);
  REQUIRE(next.size() == 3);
  CHECK(next.count_fixed() == 2);
  CHECK(next.updates[2] == 0);
  CHECK(next.set.position[3 * 2 + 1] == Approx(y));
  CHECK(next.set.velocity[3 * 2 + 1] == 0.25f);
  CHECK(next.set.time[2] == 0.0f);
  // The stored velocity and lifespan give the same.
  TrainState derived = next;
  derived.derive_all(true);
  CHECK(derived.set.velocity[3 * 2 + 1] == Approx(0.25f));
  CHECK(derived.set.sigma[2] == Approx(next.set.sigma[2]));
}

TEST_CASE("content is stored once most cameras have seen its place to be still") {
  using Indices = std::vector<std::uint32_t>;
  PreparedCapture capture;
  for (const char* name : {"a", "b", "c"}) {
    Camera camera;
    camera.name = name;
    camera.width = 10;
    camera.height = 4;
    camera.fx = camera.fy = 10;
    camera.cx = 5;
    camera.cy = 2;
    capture.cameras.push_back(camera);
  }
  TrainState state = static_state(3);
  for (int i = 0; i < 3; ++i) {
    state.set.position[3 * i] = 0.2f * static_cast<float>(i - 1);  // pixels 3, 5 and 7
    state.set.position[3 * i + 1] = 0;
    state.set.position[3 * i + 2] = 1;
  }
  CHECK(list_still(capture, state.set, {0, 1, 2}) == Indices{0, 1, 2});  // nothing is stated
  capture.memory = std::make_shared<FrameMemory>();
  const auto add = [&](const char* name, std::initializer_list<int> still) {
    Image8 mask{10, 4, 1, std::vector<std::uint8_t>(40, 0)};
    for (const int x : still) mask.data[2 * 10 + x] = 255;
    capture.memory->add_still(name, std::move(mask));
  };
  add("a", {3, 5});
  add("b", {3, 7});
  add("c", {3});
  CHECK(list_still(capture, state.set, {0, 1, 2}) == Indices{0});
  state.set.position[2] = -1;  // behind all cameras
  CHECK(list_still(capture, state.set, {0}).empty());
}
