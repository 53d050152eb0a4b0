// SPDX-License-Identifier: Apache-2.0
// Prints the time of a step of the CUDA training backend, in total and per stage, by primitives and
// image size, as one JSON line per case.
// usage: bench_train_cuda [steps=60] [sh_degree=2] [primitives=200000 size=640x360]
//                         [weight_normal=0] [perceptual=PATCH]
// PATCH: side in pixels, 0: complete images; VGG16 has random weights.
// Scenes are random and opaque like trained ones: primitives get smaller as their number grows, and
// larger in pixels with the image.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>

#include "backend/cuda/cuda_backend.h"
#include "network_fixture.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

struct Case {
  std::size_t primitives;
  int width, height;
};

struct Settings {
  int steps = 60, sh_degree = 2;
  float weight_normal = 0;
  int patch = -1;  // side of the perceptual patch, pixels; -1: off
};

using Clock = std::chrono::steady_clock;

// Milliseconds between the events that the observer of the pipeline records.
class StageTimes {
 public:
  explicit StageTimes(cudaStream_t stream) : stream_(stream) {}
  ~StageTimes() {
    for (const auto& [name, event] : marks_) cudaEventDestroy(event);
  }
  void mark(const char* stage) {
    cudaEvent_t event = nullptr;
    if (cudaEventCreate(&event) != cudaSuccess) return;
    cudaEventRecord(event, stream_);
    marks_.emplace_back(stage, event);
  }
  // Means over the marked steps, in the order of the stages.
  std::vector<std::pair<std::string, double>> means(int steps) const {
    std::vector<std::pair<std::string, double>> sums;
    for (std::size_t k = 1; k < marks_.size(); ++k) {
      if (std::strcmp(marks_[k].first, "begin") == 0) continue;
      float ms = 0;
      cudaEventElapsedTime(&ms, marks_[k - 1].second, marks_[k].second);
      auto entry = std::find_if(sums.begin(), sums.end(),
                                [&](const auto& sum) { return sum.first == marks_[k].first; });
      if (entry == sums.end()) entry = sums.insert(sums.end(), {marks_[k].first, 0.0});
      entry->second += static_cast<double>(ms) / steps;
    }
    return sums;
  }

 private:
  cudaStream_t stream_;
  std::vector<std::pair<const char*, cudaEvent_t>> marks_;
};

bool failed(const Status& status) {
  if (!status.ok()) std::fprintf(stderr, "bench_train_cuda: %s\n", status.message().c_str());
  return !status.ok();
}

Status run_steps(cuda::CudaBackend& backend, const Case& c, const Settings& settings, int steps,
                 const std::vector<Image8>& ground_truths, StepOutput& last) {
  for (int s = 0; s < steps; ++s) {
    math::PinholeCamera camera = scene_camera(c.width, c.height);
    camera.translation.x += 0.02f * static_cast<float>(s % 5);
    StepInput input = train_step(camera, ground_truths[s % ground_truths.size()],
                                 8.0f + static_cast<float>(s % 5), settings.sh_degree);
    input.colour_index = static_cast<std::size_t>(s) % 3;
    input.weight_normal = settings.weight_normal;
    // Rates of 0 keep the scene unchanged.
    input.rates = {};
    input.rate_sh0 = input.rate_colour = 0.0f;
    if (settings.patch >= 0) {
      Random random(1, static_cast<std::uint64_t>(s), RandomPurpose::kPatch);
      input.weight_perceptual = 0.01f;
      input.patch = random_patch(c.width, c.height, settings.patch, random);
    }
    STGS_TRY(backend.step(input));
  }
  STGS_ASSIGN(const std::vector<StepOutput> outputs, backend.read());
  last = outputs.back();
  return {};
}

Status measure(const Case& c, const Settings& settings) {
  SceneShape shape;
  shape.sh_degree = settings.sh_degree;
  // At the scale of the shape, 200,000 primitives cover a width of 640 pixels.
  shape.log_scale_mean = -4.4f - 0.5f * std::log(static_cast<float>(c.primitives) / 200000.0f);
  TrainState state =
      train_state(random_scene(c.primitives, scene_camera(c.width, c.height), 5, shape), 3);
  std::vector<Image8> ground_truths;
  for (unsigned k = 0; k < 4; ++k)
    ground_truths.push_back(random_ground_truth(c.width, c.height, k));
  std::size_t free_before = 0, free_after = 0, total = 0;
  cudaMemGetInfo(&free_before, &total);
  cuda::CudaBackend backend;
  STGS_TRY(backend.create());
  TrainPlan plan{state.size(), state.set.sh_coefficients(), c.width, c.height};
  if (settings.patch >= 0) {
    plan.perceptual = random_network("vgg", 1, true);
    plan.perceptual_patch = settings.patch;
  }
  STGS_TRY(backend.reserve(plan));
  Clock::time_point start = Clock::now();
  STGS_TRY(backend.begin(state));
  STGS_TRY(backend.synchronise());
  STGS_TRY(backend.begin(state));
  STGS_TRY(backend.synchronise());
  const double copies = std::chrono::duration<double, std::milli>(Clock::now() - start).count() / 2;
  StepOutput last;
  STGS_TRY(run_steps(backend, c, settings, 20, ground_truths, last));
  start = Clock::now();
  STGS_TRY(run_steps(backend, c, settings, settings.steps, ground_truths, last));
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  // The steps have gathered statistics; unreachable thresholds keep the scene unchanged.
  HyperParameters parameters;
  parameters.max_primitives = static_cast<int>(c.primitives);
  parameters.clone_gradient = parameters.split_gradient = 1e9;
  parameters.prune_opacity = 0.0;
  parameters.prune_scale = 1e9;
  start = Clock::now();
  for (const DensifyStep step : {DensifyStep::kGrow, DensifyStep::kReplace}) {
    STGS_TRY(backend.densify({&parameters, {}, step, false}).status());
  }
  const double densify = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  StageTimes times(backend.stream());
  backend.pipeline().observe([&](const char* stage) { times.mark(stage); });
  STGS_TRY(run_steps(backend, c, settings, 20, ground_truths, last));
  cudaMemGetInfo(&free_after, &total);
  std::printf(
      "{\"primitives\": %zu, \"width\": %d, \"height\": %d, \"sh_degree\": %d, "
      "\"visible\": %zu, \"instances\": %zu, \"step_ms\": %.4f, ",
      c.primitives, c.width, c.height, settings.sh_degree, last.visible,
      backend.max_recent_instances(), 1e3 * seconds / settings.steps);
  for (const auto& [name, ms] : times.means(20)) std::printf("\"%s\": %.4f, ", name.c_str(), ms);
  std::printf(
      "\"grow_and_replace_ms\": %.2f, \"copy_both_ways_ms\": %.2f, "
      "\"gpu_memory_mib\": %.0f}\n",
      densify, copies, static_cast<double>(free_before - free_after) / (1 << 20));
  std::fflush(stdout);
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  Case chosen{0, 640, 360};
  for (int i = 1; i < argc; ++i) {
    unsigned long long n = 0;
    if (std::sscanf(argv[i], "steps=%d", &settings.steps) == 1 ||
        std::sscanf(argv[i], "sh_degree=%d", &settings.sh_degree) == 1 ||
        std::sscanf(argv[i], "weight_normal=%f", &settings.weight_normal) == 1 ||
        std::sscanf(argv[i], "perceptual=%d", &settings.patch) == 1 ||
        std::sscanf(argv[i], "size=%dx%d", &chosen.width, &chosen.height) == 2)
      continue;
    if (std::sscanf(argv[i], "primitives=%llu", &n) == 1) {
      chosen.primitives = n;
      continue;
    }
    std::fprintf(stderr, "bench_train_cuda: unknown option '%s'\n", argv[i]);
    return 1;
  }
  // Initialises the device.
  if (failed(cuda::CudaBackend().create())) return 5;
  std::vector<Case> cases = {chosen};
  if (chosen.primitives == 0) {
    cases.clear();
    for (const std::size_t n : {100000, 200000, 300000, 1000000}) {
      cases.push_back({n, 640, 360});
      cases.push_back({n, 1920, 1080});
      cases.push_back({n, 3840, 2160});
    }
  }
  for (const Case& c : cases) {
    if (failed(measure(c, settings))) return 4;
  }
  return 0;
}
