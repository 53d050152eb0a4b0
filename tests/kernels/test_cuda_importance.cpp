// SPDX-License-Identifier: Apache-2.0
// Weighing primitives on the CUDA backend against the CPU's (train/importance.h); compared as in
// test_cuda_backend.cpp.
#include <cstdio>

#include "cuda_backend_check.h"
#include "importance_scene.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

bool always(double) {
  return true;
}

std::vector<float> weigh(cuda::CudaBackend& backend, TrainState& state,
                         const std::vector<ImportanceView>& views) {
  check(backend.begin(state));
  Result<std::optional<std::vector<float>>> found = backend.importance(views, always);
  check(found.status());
  REQUIRE(found->has_value());
  return **found;
}

// On a backend of its own, which knows nothing of how many tiles such views take.
// Returns how many it has seen.
std::size_t check_alike(TrainState state, int width, int height) {
  INFO(state.size() << " primitives, " << width << "x" << height);
  cuda::CudaBackend backend;
  check(backend.create());
  TrainPlan plan;
  plan.primitives = state.size();
  plan.sh_coefficients = state.set.sh_coefficients();
  plan.width = width;
  plan.height = height;
  plan.coupled = state.is_coupled();
  check(backend.reserve(plan));
  const std::vector<ImportanceView> views = importance_scene_views(width, height);
  const auto expected = view_importance(state.set, views, always);
  const std::vector<float> found = weigh(backend, state, views);
  const double wrong = difference(*expected, found);
  std::printf("importance of %zu primitives, %dx%d: %.2e\n", state.size(), width, height, wrong);
  CHECK(wrong <= 2e-5);
  CHECK(weigh(backend, state, views) == found);
  return backend.max_recent_instances();
}

}  // namespace

TEST_CASE("primitives weigh what they do on the CPU, to the same bits when repeated") {
  struct Case {
    std::size_t primitives;
    int width, height;
    SceneShape shape;
  };
  std::size_t most = 0;
  // The last: more tile instances than there is room for at first.
  for (const Case& c :
       {Case{3000, 160, 96, {}}, Case{500, 101, 67, {3, -2.5f, 0.8f}}, Case{2000, 17, 33, {}},
        Case{20000, 640, 360, {}}, Case{3000, 640, 360, {3, -0.5f, 0.5f}}}) {
    const math::PinholeCamera camera = scene_camera(c.width, c.height);
    TrainState state = train_state(random_scene(c.primitives, camera, 5, c.shape), 1);
    most = check_alike(std::move(state), c.width, c.height);
  }
  CHECK(most > std::size_t{1} << 16);
  Gaussians4D set = random_scene(2000, scene_camera(160, 96), 5, {.sh_degree = 2});
  check_alike(testing::coupled_state(std::move(set), 1, 1.0f / 30.0f), 160, 96);
}

TEST_CASE("weighing between steps changes nothing, nor does stopping it") {
  const int width = 160, height = 96;
  const Image8 truth = random_truth(width, height, 100);
  const std::vector<ImportanceView> views = importance_scene_views(width, height);
  const auto run = [&](bool weighs) {
    TrainState state = train_state(random_scene(3000, scene_camera(width, height), 5, {}), 1);
    cuda::CudaBackend& backend = cuda_backend();
    check(backend.reserve({state.size(), state.set.sh_coefficients(), width, height}));
    check(backend.begin(state));
    for (int s = 0; s < 6; ++s) {
      check(backend.step(train_step(scene_camera(width, height), truth, 8.0f, 2)));
      if (!weighs) continue;
      int left = s;
      const auto found = backend.importance(views, [&left](double) { return left-- > 0; });
      check(found.status());
      CHECK(found->has_value() == (s > static_cast<int>(views.size()) - 1));
    }
    CHECK(backend.read()->size() == 6);
    check(backend.synchronise());
    return state;
  };
  CHECK(same_bits(run(true), run(false)));
}
