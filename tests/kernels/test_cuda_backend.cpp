// SPDX-License-Identifier: Apache-2.0
// Compares the CUDA training backend with the CPU backend. Exit code 77: no device found.
//
// Gradients are compared through Adam's first moments after one step from zero, which are 0.1 times
// the gradient. The backends round differently, and a pixel at the edge of a splat may be covered
// on one of them only, so arrays are compared by the norm of their difference relative to their
// norm.
#include <cstdio>
#include <filesystem>

#include "catch_runner.h"
#include "cuda_steps.h"
#include "rounded_state.h"
#include "stgs/format/raster.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

std::vector<float> flatten(const std::vector<ColourMap>& maps) {
  std::vector<float> all;
  for (const ColourMap& map : maps) all.insert(all.end(), map.begin(), map.end());
  return all;
}

std::vector<float> values_of(const math::CameraGrad& camera) {
  const math::Vec3 r = camera.rotation, t = camera.translation;
  return {r.x, r.y, r.z, t.x, t.y, t.z, camera.log_focal, camera.distortion, camera.time};
}

}  // namespace

// Fixes primitives 0, 3, ...
void fix_every_third(TrainState& state) {
  for (std::size_t i = 0; i < state.size(); i += 3) {
    state.updates[i] = kFixed;
    state.statistics.error_max[i] = 0.0f;
  }
}

TEST_CASE("one CUDA step has the losses, statistics and gradients of the CPU") {
  for (const StepCase& c : kCases) {
    const std::vector<Image8> ground_truths = random_ground_truths(c, 1);
    TrainState cpu = initial_state(c), gpu = cpu;
    const auto reference = make_cpu_backend();
    const auto with_camera = [&c](StepInput& input) {
      input.gather_camera = true;
      if (c.sh_degree % 2 == 1) input.lens = {0.05f, -0.2f};
      input.kernel = c.sh_degree % 2 == 0 ? math::kBandLimited : math::kDilated;
      input.background_is_mapped = c.sh_degree % 2 == 1;
    };
    const auto expected = run_steps(*reference, cpu, c, 1, ground_truths, with_camera);
    const auto found = run_steps(cuda_backend(), gpu, c, 1, ground_truths, with_camera);
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    REQUIRE(found.size() == 1);
    std::printf("%zu primitives, %dx%d: loss %.7f (CPU %.7f), visible %zu (%zu)\n", c.primitives,
                c.width, c.height, found[0].loss, expected[0].loss, found[0].visible,
                expected[0].visible);
    CHECK(found[0].loss == Approx(expected[0].loss).epsilon(1e-5));
    CHECK(found[0].l1 == Approx(expected[0].l1).epsilon(1e-5));
    CHECK(found[0].mse == Approx(expected[0].mse).epsilon(1e-5));
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
    compare("colour", flatten(cpu.colour_first), flatten(gpu.colour_first), 1e-3);
    compare("colour map", flatten(cpu.colour), flatten(gpu.colour), 1e-4);
    REQUIRE(found[0].camera);
    compare("camera", values_of(*expected[0].camera), values_of(*found[0].camera), 3e-3);
    CHECK(found[0].vignetting == Approx(expected[0].vignetting).epsilon(1e-3));
  }
}

TEST_CASE("CUDA steps that round have the losses and gradients of the CPU") {
  const auto with_rate = [](StepInput& input) {
    input.weight_rate = 1e-6f;
    input.learn_radius = false;
    input.rates[kTime] = input.rates[kLogSigma] = input.rates[kRadius] = 0;
  };
  for (const StepCase& c : {StepCase{3000, 160, 96, 3, {}}, kPlain}) {
    const std::vector<Image8> ground_truths = random_ground_truths(c, 1);
    TrainState cpu = initial_state(c);
    if (c.primitives == 3000) fix_every_third(cpu);
    begin_rounding(cpu, 20, 80);
    TrainState gpu = cpu;
    const auto reference = make_cpu_backend();
    const auto expected = run_steps(*reference, cpu, c, 2, ground_truths, with_rate);
    const auto found = run_steps(cuda_backend(), gpu, c, 2, ground_truths, with_rate);
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    REQUIRE(found.size() == 2);
    for (std::size_t k = 0; k < 2; ++k) {
      std::printf("rounding, step %zu: loss %.7f (CPU %.7f)\n", k, found[k].loss, expected[k].loss);
      CHECK(found[k].loss == Approx(expected[k].loss).epsilon(k == 0 ? 1e-5 : 1e-3));
    }
    for (int a = 0; a < kAttributes; ++a) {
      const double d = difference(cpu.moments[a].first, gpu.moments[a].first);
      std::printf("  %-12s %.2e\n", kAttributeNames[a], d);
      INFO(kAttributeNames[a]);
      CHECK(d <= 2e-2);
    }
    CHECK(cpu.values(kTime) == gpu.values(kTime));
  }
}

TEST_CASE("L_n alone has the value and gradients of the CPU") {
  const auto normal_loss_only = [](StepInput& input) {
    input.weight_l1 = input.weight_ssim = 0.0f;
    input.weight_lifespan = input.weight_opacity = input.weight_scale = 0.0f;
    input.weight_normal = 1.0f;
  };
  // Scenes that cover the image; in the last one few pixels show a surface.
  const std::vector<StepCase> cases = {
      {3000, 160, 96, 1, {3, -2.0f, 0.5f}},   {500, 101, 67, 1, {3, -1.0f, 0.5f}},
      {400, 333, 211, 2, {3, -0.7f, 0.5f}},   {40, 19, 35, 0, {3, 0.0f, 0.3f}},
      {20000, 640, 360, 0, {3, -2.8f, 0.6f}}, kPlain};
  for (const StepCase& c : cases) {
    const std::vector<Image8> ground_truths = random_ground_truths(c, 1);
    TrainState cpu = initial_state(c), gpu = cpu;
    const auto reference = make_cpu_backend();
    const std::vector<StepOutput> expected =
        run_steps(*reference, cpu, c, 1, ground_truths, normal_loss_only);
    const std::vector<StepOutput> found =
        run_steps(cuda_backend(), gpu, c, 1, ground_truths, normal_loss_only);
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

TEST_CASE("the image of a CUDA step matches the CPU rasteriser") {
  for (const StepCase& c : kCases) {
    const std::vector<Image8> ground_truths = random_ground_truths(c, 1);
    TrainState state = initial_state(c);
    const Gaussians4D set = state.set;
    run_steps(cuda_backend(), state, c, 1, ground_truths);
    const std::size_t pixels = std::size_t{1} * c.width * c.height;
    std::vector<float> found(4 * pixels);
    REQUIRE(cudaMemcpy(found.data(), cuda_backend().pipeline().workspace().image,
                       found.size() * sizeof(float), cudaMemcpyDeviceToHost) == cudaSuccess);
    SplatFrame frame;
    RasterOutput output;
    RasterSettings settings;
    settings.max_sh_degree = c.sh_degree;
    const math::PinholeCamera camera = scene_camera(c.width, c.height);
    const StepInput input = train_step(camera, ground_truths[0], 8.0f, c.sh_degree);
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
    // A splat at the threshold, 1/255 of its colour, may be missing in very few pixels.
    CHECK(worst <= 1.5e-2);
    CHECK(sum / static_cast<double>(4 * pixels) <= 2e-6);
  }
}

TEST_CASE("twenty CUDA steps reach the state of the CPU") {
  for (const StepCase& c : {kCases[0], kCases[1], kCases[3]}) {
    const std::vector<Image8> ground_truths = random_ground_truths(c, 4);
    const TrainState start = initial_state(c);
    TrainState cpu = start, gpu = start;
    const auto reference = make_cpu_backend();
    const std::vector<StepOutput> expected = run_steps(*reference, cpu, c, 20, ground_truths);
    const std::vector<StepOutput> found = run_steps(cuda_backend(), gpu, c, 20, ground_truths);
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    REQUIRE(found.size() == 20);
    for (int s = 0; s < 20; ++s) CHECK(found[s].loss == Approx(expected[s].loss).epsilon(2e-4));
    CHECK(difference(cpu.updates, gpu.updates) <= 1e-2);
    for (int a = 0; a < kAttributes; ++a) {
      // Compares the changes. Adam makes full steps even for the smallest gradients, so gradients
      // that are rounding errors diverge.
      FloatArray change_cpu = cpu.values(a), change_gpu = gpu.values(a);
      for (std::size_t i = 0; i < change_cpu.size(); ++i) {
        change_cpu[i] -= start.values(a)[i];
        change_gpu[i] -= start.values(a)[i];
      }
      const double d = difference(change_cpu, change_gpu);
      std::printf("  %-12s %.2e\n", kAttributeNames[a], d);
      INFO(kAttributeNames[a]);
      CHECK(d <= 3e-2);
    }
    CHECK(difference(flatten(cpu.colour), flatten(gpu.colour)) <= 1e-4);
  }
}

TEST_CASE("CUDA limits scales as the CPU does, for any number of cameras") {
  const StepCase& c = kCases[0];
  std::vector<math::PinholeCamera> cameras;
  for (int k = 0; k < 70; ++k) {
    math::PinholeCamera camera = scene_camera(c.width, c.height);
    camera.translation.z += 0.1f * static_cast<float>(k % 35);
    camera.cx += 4.0f * static_cast<float>(k - 35);
    cameras.push_back(camera);
  }
  TrainState cpu = initial_state(c), gpu = cpu;
  const FloatArray before = cpu.set.log_scale;
  const auto reference = make_cpu_backend();
  for (const auto& [backend, state] :
       {std::pair{reference.get(), &cpu}, {static_cast<TrainBackend*>(&cuda_backend()), &gpu}}) {
    check(backend->reserve({state->size(), state->set.sh_coefficients(), c.width, c.height}));
    check(backend->begin(*state));
    check(backend->limit_scales(cameras, 2.0f));
    check(backend->synchronise());
  }
  CHECK(cpu.set.log_scale != before);
  CHECK(difference(cpu.set.log_scale, gpu.set.log_scale) <= 1e-6);
}

// Returns how many of the fixed primitives, or of the others, have another value.
std::size_t changed_since(const TrainState& before, const TrainState& after, bool fixed) {
  std::size_t changed = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (before.is_fixed(i) != fixed) continue;
    bool same = before.updates[i] == after.updates[i];
    for (int a = 0; a < kAttributes; ++a) {
      const auto n = static_cast<std::size_t>(before.components(a));
      const float* from = before.values(a).data() + i * n;
      same = same && std::equal(from, from + n, after.values(a).data() + i * n);
    }
    changed += same ? 0 : 1;
  }
  return changed;
}

TEST_CASE("steps with f = 1, a fixed radius or an empty state succeed") {
  const StepCase c = kCases[0];
  const std::vector<Image8> ground_truths = random_ground_truths(c, 1);
  TrainState cpu = initial_state(c);
  cpu.derive_all(false);
  TrainState gpu = cpu;
  StepInput input = train_step(scene_camera(c.width, c.height), ground_truths[0], 9.0f, 3);
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

// Statistics as after some steps, with some transparent and some non-finite primitives.
TrainState state_before_densification() {
  TrainState state = initial_state({5000, 320, 200, 3, {3, -3.0f, 0.8f}});
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

TEST_CASE("fixed primitives are rendered as on the CPU and do not change") {
  const StepCase& c = kCases[1];
  const std::vector<Image8> ground_truths = random_ground_truths(c, 4);
  TrainState start = initial_state(c);
  fix_every_third(start);
  TrainState cpu = start, gpu = start;
  const auto reference = make_cpu_backend();
  const auto with_statistics = [](StepInput& input) { input.gather_statistics = true; };
  const auto expected = run_steps(*reference, cpu, c, 5, ground_truths, with_statistics);
  const auto found = run_steps(cuda_backend(), gpu, c, 5, ground_truths, with_statistics);
  for (std::size_t s = 0; s < expected.size(); ++s)
    CHECK(found[s].loss == Approx(expected[s].loss).epsilon(2e-4));
  const math::PinholeCamera camera = scene_camera(c.width, c.height);
  for (const auto& [backend, state] :
       {std::pair{reference.get(), &cpu}, {static_cast<TrainBackend*>(&cuda_backend()), &gpu}}) {
    check(backend->limit_scales({&camera, 1}, 20.0f));
    check(backend->synchronise());
    CHECK(changed_since(start, *state, true) == 0);
    CHECK(changed_since(start, *state, false) > 0);
    for (std::size_t i = 0; i < state->size(); i += 3) CHECK(state->statistics.views[i] == 0);
  }
  CHECK(difference(cpu.set.position, gpu.set.position) <= 1e-4);
}

TEST_CASE("densification makes the same decisions as on the CPU") {
  HyperParameters parameters = *preset_hyper_parameters("fast");
  for (const DensifyStep step :
       {DensifyStep::kGrow, DensifyStep::kReplace, DensifyStep::kRelocate}) {
    for (const auto& [max_primitives, with_fixed] :
         {std::pair{5200, false}, {20000, false}, {5200, true}}) {
      DensifyContext context{2.0f, true, max_primitives == 20000, 11, {}, {{0, 0, 0}, 0.5f}};
      context.free_space.count = 1;
      context.free_space.views[0] = {
          {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}, 0.2f, 0.2f, 3.5f, 0.1f};
      INFO("step " << static_cast<int>(step) << ", at most " << max_primitives);
      parameters.max_primitives = max_primitives;
      const DensifyInput input{&parameters, context, step, step == DensifyStep::kGrow};
      TrainState cpu = state_before_densification();
      if (with_fixed) fix_every_third(cpu);
      TrainState gpu = cpu;
      CHECK(densify_both(cpu, gpu, input).non_finite == (with_fixed ? 4 : 6));
      CHECK(cpu.count_fixed() == gpu.count_fixed());
      for (int a = 0; a < kAttributes; ++a) {
        INFO(kAttributeNames[a]);
        CHECK(cpu.moments[a].first == gpu.moments[a].first);
        // replace() leaves non-finite primitives that it has no replacement for.
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

int main(int argc, char** argv) {
  cuda::CudaBackend backend;
  const Status status = backend.create();
  if (status.code() == StatusCode::kUnsupported) {
    std::printf("skipped: %s\n", status.message().c_str());
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
