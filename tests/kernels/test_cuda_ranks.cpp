// SPDX-License-Identifier: Apache-2.0
// Compares a step of several ranks on CUDA with the CPU. The ranks are threads that share the
// device and exchange their blocks through host memory.
#include <algorithm>
#include <memory>
#include <random>

#include "cuda_backend_check.h"
#include "thread_ranks.h"
#include "train/coupled_state.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

class HostExchange final : public cuda::RankExchange {
 public:
  explicit HostExchange(Ranks& ranks) : ranks_(ranks) {}
  Status all_gather(void* blocks, std::size_t bytes, cudaStream_t stream) override {
    const auto size = static_cast<std::size_t>(ranks_.size());
    std::vector<std::uint8_t> own(bytes), all(bytes * size);
    auto* device = static_cast<std::uint8_t*>(blocks);
    const auto rank = static_cast<std::size_t>(ranks_.rank());
    STGS_TRY(cuda::cuda_status(
        cudaMemcpyAsync(own.data(), device + rank * bytes, bytes, cudaMemcpyDeviceToHost, stream),
        "reading a block"));
    STGS_TRY(cuda::cuda_status(cudaStreamSynchronize(stream), "reading a block"));
    STGS_TRY(ranks_.all_gather(own.data(), bytes, all.data()));
    STGS_TRY(cuda::cuda_status(
        cudaMemcpyAsync(device, all.data(), all.size(), cudaMemcpyHostToDevice, stream),
        "writing the blocks"));
    return cuda::cuda_status(cudaStreamSynchronize(stream), "writing the blocks");
  }
  Status check() override { return {}; }
  void abort() override {}

 private:
  Ranks& ranks_;
};

struct Case {
  std::size_t primitives;
  int width, height, sh_degree, ranks, steps;
  bool coupled = false;
  bool crowded = false;  // the second rank's view has more tile instances than its allocation
};

TrainState initial_state(const Case& c) {
  SceneShape shape;
  if (c.crowded) shape = {3, -0.5f, 0.5f};
  shape.sh_degree = 3;
  Gaussians4D set = random_scene(c.primitives, scene_camera(c.width, c.height), 5, shape);
  return c.coupled ? coupled_state(std::move(set), 3, 0.1f) : train_state(std::move(set), 3);
}

StepInput make_input(const Case& c, const std::vector<Image8>& ground_truths, int rank, int step) {
  StepInput input;
  std::vector<BatchView> batch;
  for (int r = 0; r < c.ranks; ++r) {
    math::PinholeCamera camera = scene_camera(c.width, c.height);
    camera.translation.x += 0.5f * static_cast<float>(r) + 0.05f * static_cast<float>(step % 3);
    // In a crowded case the first rank sees few primitives.
    if (c.crowded && r == 0) camera.translation.x += 40.0f;
    StepInput own =
        train_step(camera, ground_truths[r], 5.0f + 4.0f * static_cast<float>(r), c.sh_degree);
    own.modulated = own.learn_radius = !c.coupled;
    own.colour_index = static_cast<std::size_t>((r + step) % 2);
    own.betas = {0.81f, 0.998f};
    batch.push_back({math::camera_centre(camera), own.ticks, own.colour_index});
    if (r == rank) input = own;
  }
  input.batch = batch;
  return input;
}

// Per rank: the state after the steps, their outputs, the number of retried steps, and the status.
struct Outcome {
  std::vector<TrainState> states;
  std::vector<std::vector<StepOutput>> outputs;
  std::vector<std::size_t> retried;
  std::vector<Status> statuses;
};

Status run_steps(TrainBackend& backend, TrainState& state, const Case& c,
                 const std::vector<Image8>& ground_truths, int rank,
                 std::vector<StepOutput>& outputs) {
  TrainPlan plan;
  plan.primitives = state.size();
  plan.sh_coefficients = state.set.sh_coefficients();
  plan.width = c.width;
  plan.height = c.height;
  plan.coupled = c.coupled;
  STGS_TRY(backend.reserve(plan));
  STGS_TRY(backend.begin(state));
  for (int s = 0; s < c.steps; ++s) STGS_TRY(backend.step(make_input(c, ground_truths, rank, s)));
  STGS_ASSIGN(outputs, backend.read());
  return backend.synchronise();
}

Outcome run(const Case& c, bool on_cuda) {
  std::vector<Image8> ground_truths;
  for (int r = 0; r < c.ranks; ++r)
    ground_truths.push_back(random_ground_truth(c.width, c.height, 60 + r));
  const auto count = static_cast<std::size_t>(c.ranks);
  Outcome outcome;
  outcome.states.assign(count, initial_state(c));
  outcome.outputs.resize(count);
  outcome.retried.resize(count);
  outcome.statuses.resize(count);
  on_ranks(c.ranks, [&](Ranks& ranks) {
    const auto r = static_cast<std::size_t>(ranks.rank());
    const auto steps = [&](TrainBackend& backend) {
      return run_steps(backend, outcome.states[r], c, ground_truths, ranks.rank(),
                       outcome.outputs[r]);
    };
    Status& status = outcome.statuses[r];
    if (on_cuda) {
      cuda::CudaBackend backend;
      status = backend.create();
      if (status.ok()) status = backend.join(ranks, std::make_unique<HostExchange>(ranks));
      if (status.ok()) status = steps(backend);
      outcome.retried[r] = backend.retried_steps();
    } else {
      const auto backend = make_cpu_backend();
      status = backend->join(ranks);
      if (status.ok()) status = steps(*backend);
    }
  });
  for (const Status& status : outcome.statuses) check(status);
  return outcome;
}

}  // namespace

TEST_CASE("a CUDA step of several ranks has the gradients, losses and statistics of the CPU") {
  for (const Case& c : {Case{3000, 160, 96, 3, 2, 1}, Case{1111, 101, 67, 1, 3, 1},
                        Case{900, 120, 80, 0, 2, 1, true}}) {
    const Outcome expected = run(c, false), found = run(c, true);
    INFO(c.primitives << " primitives, " << c.ranks << " ranks");
    for (const TrainState& state : found.states) CHECK(same_bits(found.states[0], state));
    REQUIRE(found.outputs[0].size() == static_cast<std::size_t>(c.ranks));
    for (std::size_t r = 0; r < found.outputs[0].size(); ++r) {
      CHECK(found.outputs[1][r].loss == found.outputs[0][r].loss);
      CHECK(found.outputs[0][r].loss == Approx(expected.outputs[0][r].loss).epsilon(1e-5));
    }
    const TrainState &cpu = expected.states[0], &gpu = found.states[0];
    for (int a = 0; a < kAttributes; ++a) {
      INFO(kAttributeNames[a]);
      CHECK(difference(cpu.moments[a].first, gpu.moments[a].first) <= 3e-3);
      CHECK(difference(cpu.moments[a].second, gpu.moments[a].second) <= 6e-3);
    }
    CHECK(difference(cpu.updates, gpu.updates) <= 2e-2);
    CHECK(difference(cpu.statistics.views, gpu.statistics.views) <= 2e-2);
    CHECK(difference(cpu.statistics.gradient_sum, gpu.statistics.gradient_sum) <= 2e-3);
    CHECK(difference(cpu.statistics.error_max, gpu.statistics.error_max) <= 1e-3);
    for (std::size_t k = 0; k < cpu.colour.size(); ++k) {
      for (int j = 0; j < 12; ++j) CHECK(cpu.colour[k][j] == Approx(gpu.colour[k][j]).margin(1e-5));
    }
    CHECK(cpu.colour_updates == gpu.colour_updates);
  }
}

TEST_CASE("ranks keep identical states over many steps, even if one outgrows its allocation") {
  for (const Case& c :
       {Case{3000, 160, 96, 2, 2, 40}, Case{3000, 640, 360, 0, 2, 40, false, true}}) {
    const Outcome first = run(c, true), second = run(c, true);
    INFO((c.crowded ? "crowded" : "plain"));
    CHECK(same_bits(first.states[0], first.states[1]));
    CHECK(same_bits(first.states[0], second.states[0]));
    CHECK((first.retried[0] > 0) == c.crowded);
    CHECK(first.retried[0] == first.retried[1]);
    REQUIRE(first.outputs[0].size() == 80);
    for (int s : {0, 1, 40, 79}) CHECK(first.outputs[0][s].loss == second.outputs[1][s].loss);
  }
}
