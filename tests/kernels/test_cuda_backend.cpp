// SPDX-License-Identifier: Apache-2.0
// The CUDA training backend against the CPU's. Exit code 77: there is no device.
//
// Gradients are compared through Adam's first moments after one step from zero, which are 0.1 times
// the gradient. Both backends round differently, and a pixel at the edge of a splat may be drawn by
// one alone; so arrays are compared by the length of their difference against their own length.
#include <cstdio>
#include <filesystem>
#include <functional>

#include "catch.h"
#include "catch_runner.h"
#include "cuda_backend_check.h"
#include "stgs/encoder/train.h"
#include "stgs/format/raster.h"
#include "synthetic_capture.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

struct Case {
  std::size_t primitives;
  int width, height;
  int sh_degree;
  SceneShape shape;
};

std::vector<float> flat(const std::vector<ColourMap>& maps) {
  std::vector<float> all;
  for (const ColourMap& map : maps) all.insert(all.end(), map.begin(), map.end());
  return all;
}

// Runs `steps` steps over a few moments and cameras, each as `change` leaves it; what each gave.
std::vector<StepOutput> run(TrainBackend& backend, TrainState& state, const Case& c, int steps,
                            const std::vector<Image8>& truths,
                            const std::function<void(StepInput&)>& change = {}) {
  check(backend.reserve({state.size(), state.set.sh_coefficients(), c.width, c.height}));
  check(backend.begin(state));
  for (int s = 0; s < steps; ++s) {
    math::PinholeCamera camera = scene_camera(c.width, c.height);
    camera.translation.x += 0.05f * static_cast<float>(s % 3);
    StepInput input = train_step(camera, truths[s % truths.size()],
                                 8.0f + static_cast<float>(s % 5), c.sh_degree);
    input.colour_index = static_cast<std::size_t>(s) % state.colour.size();
    if (change) change(input);
    check(backend.step(input));
  }
  Result<std::vector<StepOutput>> outputs = backend.read();
  check(outputs.status());
  check(backend.synchronise());
  return *outputs;
}

std::vector<Image8> truths_of(const Case& c, int count) {
  std::vector<Image8> truths;
  for (int k = 0; k < count; ++k) truths.push_back(random_truth(c.width, c.height, 100 + k));
  return truths;
}

TrainState state_of(const Case& c) {
  SceneShape shape = c.shape;
  shape.sh_degree = 3;
  return train_state(random_scene(c.primitives, scene_camera(c.width, c.height), 5, shape), 3);
}

const Case kPlain = {20000, 640, 360, 2, {}};
// Large splats: more tile instances than a first step has room for.
const Case kCrowded = {3000, 640, 360, 0, {3, -0.5f, 0.5f}};
const std::vector<Case> kCases = {
    {3000, 160, 96, 3, {}},
    {500, 101, 67, 1, {3, -2.5f, 0.8f}},
    {2000, 17, 33, 0, {}},
    {400, 333, 211, 2, {3, -1.0f, 0.7f}},
    kPlain,
    kCrowded,
};

}  // namespace

TEST_CASE("one step has the CPU's losses, statistics and gradients") {
  for (const Case& c : kCases) {
    const std::vector<Image8> truths = truths_of(c, 1);
    TrainState cpu = state_of(c), gpu = cpu;
    const auto reference = make_cpu_backend();
    const std::vector<StepOutput> expected = run(*reference, cpu, c, 1, truths);
    const std::vector<StepOutput> found = run(cuda_backend(), gpu, c, 1, truths);
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    REQUIRE(found.size() == 1);
    std::printf("%zu primitives, %dx%d: loss %.7f (CPU %.7f), visible %zu (%zu)\n", c.primitives,
                c.width, c.height, found[0].loss, expected[0].loss, found[0].visible,
                expected[0].visible);
    CHECK(found[0].loss == Approx(expected[0].loss).epsilon(1e-5));
    CHECK(found[0].l1 == Approx(expected[0].l1).epsilon(1e-5));
    CHECK(found[0].ssim == Approx(expected[0].ssim).epsilon(1e-4).margin(1e-6));
    CHECK(std::abs(static_cast<double>(found[0].visible) -
                   static_cast<double>(expected[0].visible)) <=
          2e-4 * static_cast<double>(c.primitives));
    const auto compare = [](const char* name, const auto& a, const auto& b, double tolerance) {
      const double d = difference(a, b);
      std::printf("  %-12s %.2e\n", name, d);
      INFO(name);
      CHECK(d <= tolerance);
    };
    compare("image grad", cpu.statistics.gradient_sum, gpu.statistics.gradient_sum, 2e-3);
    compare("abs grad", cpu.statistics.abs_gradient_sum, gpu.statistics.abs_gradient_sum, 1e-3);
    compare("E", cpu.statistics.error_max, gpu.statistics.error_max, 1e-3);
    compare("views", cpu.statistics.views, gpu.statistics.views, 2e-2);
    for (int a = 0; a < kAttributes; ++a) {
      compare(kAttributeNames[a], cpu.moments[a].first, gpu.moments[a].first, 3e-3);
      CHECK(difference(cpu.moments[a].second, gpu.moments[a].second) <= 6e-3);
    }
    compare("colour", flat(cpu.colour_first), flat(gpu.colour_first), 1e-3);
    compare("colour map", flat(cpu.colour), flat(gpu.colour), 1e-4);
  }
}

TEST_CASE("L_n alone has the CPU's value and gradients") {
  const auto alone = [](StepInput& input) {
    input.weight_l1 = input.weight_ssim = 0.0f;
    input.weight_lifespan = input.weight_opacity = input.weight_scale = 0.0f;
    input.weight_normal = 1.0f;
  };
  // Scenes that cover the picture; of the last few pixels show a surface.
  const std::vector<Case> cases = {
      {3000, 160, 96, 1, {3, -2.0f, 0.5f}},   {500, 101, 67, 1, {3, -1.0f, 0.5f}},
      {400, 333, 211, 2, {3, -0.7f, 0.5f}},   {40, 19, 35, 0, {3, 0.0f, 0.3f}},
      {20000, 640, 360, 0, {3, -2.8f, 0.6f}}, kPlain};
  for (const Case& c : cases) {
    const std::vector<Image8> truths = truths_of(c, 1);
    TrainState cpu = state_of(c), gpu = cpu;
    const auto reference = make_cpu_backend();
    const std::vector<StepOutput> expected = run(*reference, cpu, c, 1, truths, alone);
    const std::vector<StepOutput> found = run(cuda_backend(), gpu, c, 1, truths, alone);
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    std::printf("%zu primitives, %dx%d: L_n %.7f (CPU %.7f)\n", c.primitives, c.width, c.height,
                found[0].normal, expected[0].normal);
    CHECK(expected[0].normal > 0.0);
    CHECK(found[0].normal == Approx(expected[0].normal).epsilon(1e-3));
    CHECK(found[0].loss == Approx(found[0].normal));
    for (const int a : {kPosition, kLogScale, kRotation, kOpacity, kTime, kVelocity, kLogSigma}) {
      const double d = difference(cpu.moments[a].first, gpu.moments[a].first);
      std::printf("  %-12s %.2e\n", kAttributeNames[a], d);
      INFO(kAttributeNames[a]);
      CHECK(d <= 1e-2);
    }
  }
}

TEST_CASE("the picture is the CPU rasteriser's") {
  for (const Case& c : kCases) {
    const std::vector<Image8> truths = truths_of(c, 1);
    TrainState state = state_of(c);
    const Gaussians4D set = state.set;
    run(cuda_backend(), state, c, 1, truths);
    const std::size_t pixels = std::size_t{1} * c.width * c.height;
    std::vector<float> found(4 * pixels);
    REQUIRE(cudaMemcpy(found.data(), cuda_backend().pipeline().workspace().image,
                       found.size() * sizeof(float), cudaMemcpyDeviceToHost) == cudaSuccess);
    SplatFrame frame;
    RasterOutput output;
    RasterSettings settings;
    settings.max_sh_degree = c.sh_degree;
    const math::PinholeCamera camera = scene_camera(c.width, c.height);
    const StepInput input = train_step(camera, truths[0], 8.0f, c.sh_degree);
    settings.background = input.background;
    begin_frame(camera, frame);
    slice(set, input.ticks, camera, settings, 0, frame);
    std::erase_if(frame.splats, [&input](const Splat& splat) {
      return dropped(input.drop_random, input.drop_share, splat.id);
    });
    bin(frame);
    blend(frame, settings, output);
    double worst = 0, sum = 0;
    for (std::size_t p = 0; p < pixels; ++p) {
      for (int k = 0; k < 4; ++k) {
        const float expected = k < 3 ? output.colour.plane(k)[p] : output.transmittance.data[p];
        const double d = std::abs(expected - found[4 * p + k]);
        worst = std::max(worst, d);
        sum += d;
      }
    }
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    std::printf("%dx%d: worst %.2e, mean %.2e\n", c.width, c.height, worst,
                sum / static_cast<double>(4 * pixels));
    // A splat at the threshold, 1/255 of its colour, may be missing; hardly any pixel has one.
    CHECK(worst <= 1.5e-2);
    CHECK(sum / static_cast<double>(4 * pixels) <= 2e-6);
  }
}

TEST_CASE("twenty steps leave the CPU's state") {
  for (const Case& c : {kCases[0], kCases[1], kCases[3]}) {
    const std::vector<Image8> truths = truths_of(c, 4);
    const TrainState start = state_of(c);
    TrainState cpu = start, gpu = start;
    const auto reference = make_cpu_backend();
    const std::vector<StepOutput> expected = run(*reference, cpu, c, 20, truths);
    const std::vector<StepOutput> found = run(cuda_backend(), gpu, c, 20, truths);
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    REQUIRE(found.size() == 20);
    for (int s = 0; s < 20; ++s) CHECK(found[s].loss == Approx(expected[s].loss).epsilon(2e-4));
    CHECK(difference(cpu.updates, gpu.updates) <= 1e-2);
    for (int a = 0; a < kAttributes; ++a) {
      // What the steps have moved; Adam makes full steps of the smallest gradients too, so those
      // that are rounding errors go their own way.
      FloatArray moved_cpu = cpu.values(a), moved_gpu = gpu.values(a);
      for (std::size_t i = 0; i < moved_cpu.size(); ++i) {
        moved_cpu[i] -= start.values(a)[i];
        moved_gpu[i] -= start.values(a)[i];
      }
      const double d = difference(moved_cpu, moved_gpu);
      std::printf("  %-12s %.2e\n", kAttributeNames[a], d);
      INFO(kAttributeNames[a]);
      CHECK(d <= 3e-2);
    }
    CHECK(difference(flat(cpu.colour), flat(gpu.colour)) <= 1e-4);
  }
}

TEST_CASE("the same steps give the same bits, also where room ran out on the way") {
  for (const Case& c : {kPlain, kCrowded}) {
    const std::vector<Image8> truths = truths_of(c, 4);
    TrainState first = state_of(c), second = first;
    run(cuda_backend(), first, c, 40, truths);
    cuda::CudaBackend fresh;
    check(fresh.create());
    run(fresh, second, c, 40, truths);
    CHECK((fresh.retried_steps() > 0) == (c.primitives == kCrowded.primitives));
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    CHECK(same_bits(first, second));
  }
}

TEST_CASE("steps with L_n give the same bits, and leave those without it as they were") {
  const auto with_it = [](StepInput& input) { input.weight_normal = 0.05f; };
  for (const Case& c : {kPlain, kCrowded}) {
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    const std::vector<Image8> truths = truths_of(c, 4);
    TrainState first = state_of(c), second = first, without = first, after = first;
    cuda::CudaBackend backends[2];
    for (cuda::CudaBackend& backend : backends) check(backend.create());
    run(backends[0], first, c, 20, truths, with_it);
    const std::vector<StepOutput> outputs = run(backends[1], second, c, 20, truths, with_it);
    CHECK(outputs.back().normal > 0.0);
    CHECK(same_bits(first, second));
    run(cuda_backend(), without, c, 5, truths);
    const std::vector<StepOutput> off = run(backends[0], after, c, 5, truths);
    CHECK(off.back().normal == 0.0);
    CHECK(same_bits(without, after));
    CHECK_FALSE(same_bits(without, second));
  }
}

TEST_CASE("f = 1, a fixed radius and an empty state are steps like others") {
  const Case c = kCases[0];
  const std::vector<Image8> truths = truths_of(c, 1);
  TrainState cpu = state_of(c);
  cpu.derive_all(false);
  TrainState gpu = cpu;
  StepInput input = train_step(scene_camera(c.width, c.height), truths[0], 9.0f, 3);
  input.modulated = input.learn_radius = input.second_stage = input.gather_statistics = false;
  const auto reference = make_cpu_backend();
  for (TrainBackend* backend : {reference.get(), static_cast<TrainBackend*>(&cuda_backend())}) {
    TrainState& state = backend == reference.get() ? cpu : gpu;
    check(backend->reserve({state.size(), 16, c.width, c.height}));
    check(backend->begin(state));
    check(backend->step(input));
    check(backend->synchronise());
    check(backend->read().status());
  }
  for (int a = 0; a < kAttributes; ++a) {
    INFO(kAttributeNames[a]);
    CHECK(difference(cpu.moments[a].first, gpu.moments[a].first) <= 3e-3);
  }
  CHECK(cpu.set.radius == gpu.set.radius);
  CHECK(cpu.statistics.views == gpu.statistics.views);

  TrainState empty = train_state(Gaussians4D{}, 2);
  check(cuda_backend().begin(empty));
  check(cuda_backend().step(input));
  const Result<std::vector<StepOutput>> outputs = cuda_backend().read();
  check(outputs.status());
  REQUIRE(outputs->size() == 1);
  CHECK(outputs->front().visible == 0);
  CHECK(outputs->front().loss > 0.0);
  check(cuda_backend().synchronise());
}

// Statistics as steps might have left them, some transparent and some broken primitives.
TrainState before_densification() {
  TrainState state = state_of({5000, 320, 200, 3, {3, -3.0f, 0.8f}});
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  for (std::size_t i = 0; i < state.size(); ++i) {
    state.statistics.views[i] = static_cast<std::uint32_t>(5.0f * uniform(random));
    state.statistics.gradient_sum[i] = 1e-3f * uniform(random);
    state.statistics.abs_gradient_sum[i] = 2e-3f * uniform(random);
    state.statistics.error_max[i] = 10.0f * uniform(random);
    state.updates[i] = 3;
    if (i % 17 == 3) state.set.opacity_logit[i] = -7.0f;
    if (i % 911 == 5) state.set.sh[48 * i + 20] = NAN;
    for (int a = 0; a < kAttributes; ++a) state.moments[a].first[i] = uniform(random);
  }
  state.iteration = 700;
  return state;
}

TEST_CASE("densification makes the CPU's decisions") {
  HyperParameters parameters = *preset_hyper_parameters("fast");
  for (const bool refining : {false, true}) {
    for (const int most : {5200, 20000}) {
      const DensifyContext context{2.0f, true, most == 20000, 11};
      INFO((refining ? "replace, " : "grow, ") << most << " at most");
      parameters.max_primitives = most;
      const DensifyInput input{&parameters, context, refining, !refining};
      TrainState cpu = before_densification(), gpu = cpu;
      CHECK(densify_alike(cpu, gpu, input).non_finite == 6);
      for (int a = 0; a < kAttributes; ++a) {
        INFO(kAttributeNames[a]);
        CHECK(cpu.moments[a].first == gpu.moments[a].first);
        // replace() leaves what is broken where there is nothing to put in its place.
        const FloatArray &x = cpu.values(a), &y = gpu.values(a);
        double worst = 0;
        for (std::size_t i = 0; i < x.size(); ++i) {
          if (std::isnan(x[i]) && std::isnan(y[i])) continue;
          const double d = std::abs(x[i] - y[i]);
          worst = d <= worst ? worst : d;
        }
        CHECK(worst <= 1e-5);
      }
      CHECK(difference(cpu.set.velocity, gpu.set.velocity) <= 1e-6);
      CHECK(difference(cpu.set.sigma, gpu.set.sigma) <= 1e-6);
    }
  }
}

TEST_CASE("pictures that do not fit come in turn") {
  cuda::GroundTruthCache cache;
  cuda::Stream stream;
  check(stream.create());
  const Case c{0, 64, 48, 0, {}};
  const std::vector<Image8> truths = truths_of(c, 12);
  check(cache.create(3 * truths[0].data.size()));
  std::vector<std::uint8_t> found(truths[0].data.size());
  for (std::uint64_t k = 0; k < 40; ++k) {
    const std::size_t which = k * 7 % truths.size();
    const Image8& truth = truths[which];
    TrainingImage picture = borrowed_image(truth, which);
    picture.use = k;
    picture.next_use = k % 5 == 4 ? kNeverUsed : k + truths.size();
    const Result<const std::uint8_t*> bytes = cache.acquire(picture, stream);
    check(bytes.status());
    REQUIRE(cudaMemcpyAsync(found.data(), *bytes, found.size(), cudaMemcpyDeviceToHost, stream) ==
            cudaSuccess);
    check(cache.release(picture, stream));
    check(stream.wait());
    CHECK(found == truth.data);
  }
}

TEST_CASE("a plan that does not fit is refused with what it needs") {
  cuda::CudaBackend backend;
  check(backend.create());
  const Status status = backend.reserve({2000000000, 16, 640, 360});
  CHECK(status.code() == StatusCode::kUnsupported);
  CHECK(status.message().find("GiB") != std::string::npos);
}

TEST_CASE("a plan that only just fits is taken, one that just does not is refused") {
  constexpr std::size_t kPrimitives = 2000000, kMiB = std::size_t{1} << 20;
  const TrainPlan plan{kPrimitives, 16, 640, 360};
  const std::size_t need = cuda::DeviceState::bytes(kPrimitives, 16, false) +
                           cuda::StepPipeline::bytes(kPrimitives, 640, 360, 6 * kPrimitives, false);
  for (const bool fits : {true, false}) {
    cuda::CudaBackend backend;
    check(backend.create());
    std::size_t free = 0, total = 0;
    REQUIRE(cudaMemGetInfo(&free, &total) == cudaSuccess);
    // Far less is left than the lists would take by choice.
    cuda::DeviceArray<std::uint8_t> taken;
    check(taken.ensure(free - need - 128 * kMiB + (fits ? 0 : 256 * kMiB)));
    const Status status = backend.reserve(plan);
    INFO(status.message());
    CHECK(status.ok() == fits);
    if (!fits) CHECK(status.code() == StatusCode::kUnsupported);
  }
}

TEST_CASE("training on CUDA recovers a held-out view, and resumes to the same bits") {
  const test::SyntheticCapture synthetic;
  TrainSettings settings;
  settings.backend = "cuda";
  settings.preset = "fast";
  settings.iterations = 600;
  settings.max_primitives = 600;
  settings.overrides = {{"densify_interval", "20"}, {"sh_degree", "1"}};
  check_resumes(synthetic, settings, 24.0);
}

int main(int argc, char** argv) {
  cuda::CudaBackend backend;
  const Status status = backend.create();
  if (status.code() == StatusCode::kUnsupported) {
    std::printf("skipped: %s\n", status.message().c_str());
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
