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
constexpr int kFar = 4;    // steps that there is room for
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

enum class Seen { kNothing, kAfar, kClose };  // afar: few tiles, for which there is room

StepInput step_of(const Image8& truth, int s, Seen seen) {
  math::PinholeCamera camera = scene_camera(kWidth, kHeight);
  camera.translation.x += 0.05f * static_cast<float>(s % 3);
  if (seen == Seen::kNothing) camera.translation.z -= 1000.0f;  // everything is behind it
  if (seen == Seen::kAfar) camera.translation.z += 100.0f;
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
  TrainState state = crowded_state();

  // Brings the pictures to the device.
  explicit Run(const std::vector<Image8>& truths) {
    check(backend.create());
    check(backend.reserve({state.size(), state.set.sh_coefficients(), kWidth, kHeight}));
    check(backend.begin(state));
    for (const Image8& truth : truths) check(backend.step(step_of(truth, 0, Seen::kNothing)));
    check(backend.read().status());
  }
  // Steps of the first pictures. Adds those that the backend took to `accepted`; the first error.
  Status steps(const std::vector<Image8>& truths, int count, Seen seen, int& accepted) {
    for (int s = 0; s < count; ++s) {
      STGS_TRY(backend.step(step_of(truths[static_cast<std::size_t>(s)], s, seen)));
      ++accepted;
    }
    return {};
  }
  Status end() {
    STGS_TRY(backend.read().status());
    return backend.synchronise();
  }
};

}  // namespace

TEST_CASE("steps whose memory others have taken") {
  const std::vector<Image8> few = truths_of(kSteps);
  Run roomy(few);
  const std::size_t before = free_memory();
  int accepted = 0;
  check(roomy.steps(few, kFar, Seen::kAfar, accepted));
  check(roomy.end());
  const TrainState first = roomy.state;
  check(roomy.backend.begin(roomy.state));
  check(roomy.steps(few, kSteps, Seen::kClose, accepted));
  check(roomy.end());
  const std::size_t need = before - free_memory();
  std::printf("  the steps needed %.1f MiB more\n", static_cast<double>(need) / (1 << 20));
  // More than the few pictures can give back, for which the driver takes 32 MiB at a time.
  REQUIRE(need > std::size_t{64} << 20);
  accepted = 0;

  SECTION("the pictures on the device make way") {
    const std::vector<Image8> many = truths_of(50 + 5 * need / few[0].data.size() / 4);
    Run tight(many);
    {
      const Hog hog;
      check(tight.steps(many, kFar, Seen::kAfar, accepted));
      check(tight.steps(many, kSteps, Seen::kClose, accepted));
      check(tight.end());
    }
    CHECK(tight.backend.retried_steps() > 0);
    CHECK(same_bits(roomy.state, tight.state));
  }
  SECTION("where they do not suffice, the steps before are left, and go on to the same bits") {
    Run tight(few);
    {
      const Hog hog;
      check(tight.steps(few, kFar, Seen::kAfar, accepted));
      Status status = tight.steps(few, kSteps, Seen::kClose, accepted);
      if (status.ok()) status = tight.backend.read().status();
      REQUIRE_FALSE(status.ok());
      CHECK(status.message().find("use fewer primitives") != std::string::npos);
      accepted -= static_cast<int>(tight.backend.abandon());
      check(tight.end());
    }
    REQUIRE(accepted == kFar);  // already the first of the others had too many tiles
    CHECK_FALSE(same_bits(tight.state, crowded_state()));
    CHECK(same_bits(tight.state, first));
    check(tight.backend.begin(tight.state));
    check(tight.steps(few, kSteps, Seen::kClose, accepted));
    check(tight.end());
    CHECK(same_bits(roomy.state, tight.state));
  }
}
