// SPDX-License-Identifier: Apache-2.0
// The CUDA backend with little GPU memory: steps after other programs have taken it, the cache of
// ground-truth images, and plans near the limit.
#include <cstdio>
#include <vector>

#include "cuda_steps.h"
#include "memory_hog.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

constexpr int kWidth = 640, kHeight = 360;
constexpr int kFarSteps = 4;    // steps that fit into the initial allocation
constexpr int kCloseSteps = 6;  // steps that do not

// Large splats: far more tile instances than the first step has capacity for.
TrainState crowded_state() {
  return train_state(random_scene(3000, scene_camera(kWidth, kHeight), 5, {3, -0.5f, 0.5f}), 1);
}

enum class Distance { kBehind, kFar, kClose };  // kFar: few tile instances, which fit

StepInput step_of(const Image8& ground_truth, int s, Distance distance) {
  math::PinholeCamera camera = scene_camera(kWidth, kHeight);
  camera.translation.x += 0.05f * static_cast<float>(s % 3);
  if (distance == Distance::kBehind)
    camera.translation.z -= 1000.0f;  // all primitives are behind the camera
  if (distance == Distance::kFar) camera.translation.z += 100.0f;
  StepInput input = train_step(camera, ground_truth, 8.0f + static_cast<float>(s % 5), 0);
  input.rate_colour = 0.0f;  // so that a step without visible primitives changes nothing
  return input;
}

// Equal images that the backend treats as different ones.
std::vector<Image8> equal_ground_truths(std::size_t count) {
  return std::vector<Image8>(count, random_ground_truth(kWidth, kHeight, 100));
}

std::size_t free_memory() {
  std::size_t free = 0, total = 0;
  REQUIRE(cudaMemGetInfo(&free, &total) == cudaSuccess);
  return free;
}

struct Run {
  cuda::CudaBackend backend;
  TrainState state = crowded_state();

  // Uploads the images.
  explicit Run(const std::vector<Image8>& ground_truths) {
    check(backend.create());
    check(backend.reserve({state.size(), state.set.sh_coefficients(), kWidth, kHeight}));
    check(backend.begin(state));
    for (const Image8& ground_truth : ground_truths)
      check(backend.step(step_of(ground_truth, 0, Distance::kBehind)));
    check(backend.read().status());
  }
  // Runs steps on the first images. Adds the number of accepted steps to `accepted` and returns the
  // first error.
  Status steps(const std::vector<Image8>& ground_truths, int count, Distance distance,
               int& accepted) {
    for (int s = 0; s < count; ++s) {
      STGS_TRY(backend.step(step_of(ground_truths[static_cast<std::size_t>(s)], s, distance)));
      ++accepted;
    }
    return {};
  }
  Status finish() {
    STGS_TRY(backend.read().status());
    return backend.synchronise();
  }
};

}  // namespace

TEST_CASE("steps survive other programs taking the GPU memory") {
  const std::vector<Image8> few_images = equal_ground_truths(kCloseSteps);
  Run unlimited(few_images);
  const std::size_t before = free_memory();
  int accepted = 0;
  check(unlimited.steps(few_images, kFarSteps, Distance::kFar, accepted));
  check(unlimited.finish());
  const TrainState first = unlimited.state;
  check(unlimited.backend.begin(unlimited.state));
  check(unlimited.steps(few_images, kCloseSteps, Distance::kClose, accepted));
  check(unlimited.finish());
  const std::size_t need = before - free_memory();
  std::printf("  the steps needed %.1f MiB more\n", static_cast<double>(need) / (1 << 20));
  // Exceeds the memory that the few images free; the driver allocates 32 MiB at a time.
  REQUIRE(need > std::size_t{64} << 20);
  accepted = 0;

  SECTION("cached images are evicted to free memory") {
    const std::vector<Image8> many_images =
        equal_ground_truths(50 + 5 * need / few_images[0].data.size() / 4);
    Run limited(many_images);
    {
      const MemoryHog hog;
      check(limited.steps(many_images, kFarSteps, Distance::kFar, accepted));
      check(limited.steps(many_images, kCloseSteps, Distance::kClose, accepted));
      check(limited.finish());
    }
    CHECK(limited.backend.retried_steps() > 0);
    CHECK(same_bits(unlimited.state, limited.state));
  }
  SECTION(
      "if eviction does not suffice, the completed steps remain, and resuming gives the same "
      "bits") {
    Run limited(few_images);
    {
      const MemoryHog hog;
      check(limited.steps(few_images, kFarSteps, Distance::kFar, accepted));
      Status status = limited.steps(few_images, kCloseSteps, Distance::kClose, accepted);
      if (status.ok()) status = limited.backend.read().status();
      REQUIRE_FALSE(status.ok());
      CHECK(status.message().find("use fewer primitives") != std::string::npos);
      accepted -= static_cast<int>(limited.backend.abandon());
      check(limited.finish());
    }
    // The first close step already has too many tile instances.
    REQUIRE(accepted == kFarSteps);
    CHECK_FALSE(same_bits(limited.state, crowded_state()));
    CHECK(same_bits(limited.state, first));
    check(limited.backend.begin(limited.state));
    check(limited.steps(few_images, kCloseSteps, Distance::kClose, accepted));
    check(limited.finish());
    CHECK(same_bits(unlimited.state, limited.state));
  }
}

TEST_CASE("the cache uploads images in turn if they do not fit together") {
  cuda::GroundTruthCache cache;
  cuda::Stream stream;
  check(stream.create());
  const StepCase c{0, 64, 48, 0, {}};
  const std::vector<Image8> ground_truths = random_ground_truths(c, 12);
  check(cache.create(3 * ground_truths[0].data.size()));
  std::vector<std::uint8_t> found(ground_truths[0].data.size());
  for (std::uint64_t k = 0; k < 40; ++k) {
    const std::size_t index = k * 7 % ground_truths.size();
    const Image8& ground_truth = ground_truths[index];
    TrainingImage image = borrowed_image(ground_truth, index);
    image.use = k;
    image.next_use = k % 5 == 4 ? kNeverUsed : k + ground_truths.size();
    const Result<const std::uint8_t*> bytes = cache.acquire(image, stream);
    check(bytes.status());
    REQUIRE(cudaMemcpyAsync(found.data(), *bytes, found.size(), cudaMemcpyDeviceToHost, stream) ==
            cudaSuccess);
    check(cache.release(image, stream));
    check(stream.wait());
    CHECK(found == ground_truth.data);
  }
}

TEST_CASE("a plan that does not fit is rejected with the memory that it needs") {
  cuda::CudaBackend backend;
  check(backend.create());
  const Status status = backend.reserve({2000000000, 16, 640, 360});
  CHECK(status.code() == StatusCode::kUnsupported);
  CHECK(status.message().find("GiB") != std::string::npos);
}

TEST_CASE("a plan that just fits is accepted, and one slightly larger is rejected") {
  constexpr std::size_t kPrimitives = 2000000, kMiB = std::size_t{1} << 20;
  const TrainPlan plan{kPrimitives, 16, 640, 360};
  const std::size_t need = cuda::DeviceState::bytes(kPrimitives, 16, false, false) +
                           cuda::StepPipeline::bytes(kPrimitives, 640, 360, 6 * kPrimitives, false);
  for (const bool fits : {true, false}) {
    cuda::CudaBackend backend;
    check(backend.create());
    std::size_t free = 0, total = 0;
    REQUIRE(cudaMemGetInfo(&free, &total) == cudaSuccess);
    // Leaves far less memory than the tile lists would allocate by default.
    cuda::DeviceArray<std::uint8_t> taken;
    check(taken.ensure(free - need - 128 * kMiB + (fits ? 0 : 256 * kMiB)));
    const Status status = backend.reserve(plan);
    INFO(status.message());
    CHECK(status.ok() == fits);
    if (!fits) CHECK(status.code() == StatusCode::kUnsupported);
  }
}
