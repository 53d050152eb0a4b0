// SPDX-License-Identifier: Apache-2.0
// Steps of the CUDA backend on a device whose memory others have taken since the run began.
#include <cuda_runtime_api.h>

#include <cstdio>
#include <vector>

#include "cuda_backend_check.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

constexpr int kWidth = 640, kHeight = 360;
constexpr int kSteps = 6;  // that see more than there is room for

// All memory that the device has left, in pieces of 1 MiB and more.
class Hog {
 public:
  Hog() {
    for (std::size_t bytes = std::size_t{1} << 34; bytes >= std::size_t{1} << 20; bytes /= 2) {
      for (void* piece = nullptr; cudaMalloc(&piece, bytes) == cudaSuccess;) {
        pieces_.push_back(piece);
      }
    }
    (void)cudaGetLastError();
  }
  Hog(const Hog&) = delete;
  Hog& operator=(const Hog&) = delete;
  ~Hog() {
    for (void* piece : pieces_) cudaFree(piece);
  }

 private:
  std::vector<void*> pieces_;
};

// Large splats: far more tile instances than a first step has room for.
TrainState crowded_state() {
  return train_state(random_scene(3000, scene_camera(kWidth, kHeight), 5, {3, -0.5f, 0.5f}), 1);
}

StepInput step_of(const Image8& truth, int s, bool seen) {
  math::PinholeCamera camera = scene_camera(kWidth, kHeight);
  camera.translation.x += 0.05f * static_cast<float>(s % 3);
  if (!seen) camera.translation.z -= 1000.0f;  // everything is behind it
  StepInput input = train_step(camera, truth, 8.0f + static_cast<float>(s % 5), 0);
  input.rate_colour = 0.0f;  // so that what sees nothing changes nothing
  return input;
}

// One picture many times, each of them another to the backend.
std::vector<Image8> truths_of(std::size_t count) {
  return std::vector<Image8>(count, random_truth(kWidth, kHeight, 100));
}

std::size_t free_memory() {
  std::size_t free = 0, total = 0;
  REQUIRE(cudaMemGetInfo(&free, &total) == cudaSuccess);
  return free;
}

struct Run {
  cuda::CudaBackend backend;
  TrainState state = crowded_state(), before;

  explicit Run(const std::vector<Image8>& truths) {
    check(backend.create());
    check(backend.reserve({state.size(), state.set.sh_coefficients(), kWidth, kHeight}));
    check(backend.begin(state));
    for (std::size_t s = 0; s < truths.size(); ++s) {
      check(backend.step(step_of(truths[s], static_cast<int>(s), false)));
    }
    check(backend.read().status());
    check(backend.synchronise());
    before = state;
    check(backend.begin(state));
  }
  // Steps [first, kSteps); the first error.
  Status go_on(const std::vector<Image8>& truths, int first, int& accepted) {
    for (int s = first; s < kSteps; ++s) {
      STGS_TRY(backend.step(step_of(truths[static_cast<std::size_t>(s)], s, true)));
      ++accepted;
    }
    return backend.read().status();
  }
};

}  // namespace

TEST_CASE("steps whose memory others have taken") {
  const std::vector<Image8> few = truths_of(kSteps);
  Run roomy(few);
  const std::size_t before = free_memory();
  int accepted = 0;
  check(roomy.go_on(few, 0, accepted));
  const std::size_t need = before - free_memory();
  check(roomy.backend.synchronise());
  std::printf("  the steps needed %.1f MiB more\n", static_cast<double>(need) / (1 << 20));
  // More than the few pictures can give back, for which the driver takes 32 MiB at a time.
  REQUIRE(need > std::size_t{64} << 20);
  accepted = 0;

  SECTION("the pictures on the device make way") {
    const std::vector<Image8> many = truths_of(50 + 5 * need / few[0].data.size() / 4);
    Run tight(many);
    {
      const Hog hog;
      check(tight.go_on(many, 0, accepted));
    }
    check(tight.backend.synchronise());
    CHECK(tight.backend.redone() > 0);
    CHECK(same_bits(roomy.state, tight.state));
  }
  SECTION("where they do not suffice, the steps before are left, and go on to the same bits") {
    Run tight(few);
    {
      const Hog hog;
      const Status status = tight.go_on(few, 0, accepted);
      REQUIRE_FALSE(status.ok());
      CHECK(status.message().find("use fewer primitives") != std::string::npos);
      accepted -= static_cast<int>(tight.backend.abandon());
      check(tight.backend.synchronise());
    }
    REQUIRE(accepted == 0);  // already the first had too many tiles
    CHECK(same_bits(tight.state, tight.before));
    check(tight.backend.begin(tight.state));
    check(tight.go_on(few, 0, accepted));
    check(tight.backend.synchronise());
    CHECK(same_bits(roomy.state, tight.state));
  }
}
