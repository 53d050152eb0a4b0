// SPDX-License-Identifier: Apache-2.0
// Compares importances on the CUDA and CPU backends (train/importance.h), by the measures of
// test_cuda_backend.cpp.
#include <cstdio>

#include "cuda_backend_check.h"
#include "importance_scene.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

bool keep_going(double) {
  return true;
}

std::vector<float> importance_of(cuda::CudaBackend& backend, TrainState& state,
                                 const std::vector<ImportanceView>& views) {
  check(backend.begin(state));
  Result<std::optional<std::vector<float>>> found = backend.importance(views, keep_going);
  check(found.status());
  REQUIRE(found->has_value());
  return **found;
}

// Uses a new backend, which has no estimate of the tile instances of the views.
// Returns the number of tile instances that it encountered.
std::size_t check_matches_cpu(TrainState state, int width, int height) {
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
  const auto expected = view_importance(state.set, views, keep_going);
  const std::vector<float> found = importance_of(backend, state, views);
  const double error = difference(*expected, found);
  std::printf("importance of %zu primitives, %dx%d: %.2e\n", state.size(), width, height, error);
  CHECK(error <= 2e-5);
  CHECK(importance_of(backend, state, views) == found);
  return backend.max_recent_instances();
}

}  // namespace

TEST_CASE("importances on CUDA match the CPU, with the same bits when repeated") {
  struct Case {
    std::size_t primitives;
    int width, height;
    SceneShape shape;
  };
  std::size_t instances = 0;
  // The last case has more tile instances than the initial capacity.
  for (const Case& c :
       {Case{3000, 160, 96, {}}, Case{500, 101, 67, {3, -2.5f, 0.8f}}, Case{2000, 17, 33, {}},
        Case{20000, 640, 360, {}}, Case{3000, 640, 360, {3, -0.5f, 0.5f}}}) {
    const math::PinholeCamera camera = scene_camera(c.width, c.height);
    TrainState state = train_state(random_scene(c.primitives, camera, 5, c.shape), 1);
    instances = check_matches_cpu(std::move(state), c.width, c.height);
  }
  CHECK(instances > std::size_t{1} << 16);
  Gaussians4D set = random_scene(2000, scene_camera(160, 96), 5, {.sh_degree = 2});
  check_matches_cpu(testing::coupled_state(std::move(set), 1, 1.0f / 30.0f), 160, 96);
}

TEST_CASE("computing importances between steps changes no state, whether it completes or stops") {
  const int width = 160, height = 96;
  const Image8 ground_truth = random_ground_truth(width, height, 100);
  const std::vector<ImportanceView> views = importance_scene_views(width, height);
  const auto run = [&](bool with_importance) {
    TrainState state = train_state(random_scene(3000, scene_camera(width, height), 5, {}), 1);
    cuda::CudaBackend& backend = cuda_backend();
    check(backend.reserve({state.size(), state.set.sh_coefficients(), width, height}));
    check(backend.begin(state));
    for (int s = 0; s < 6; ++s) {
      check(backend.step(train_step(scene_camera(width, height), ground_truth, 8.0f, 2)));
      if (!with_importance) continue;
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
