// SPDX-License-Identifier: Apache-2.0
// The perceptual loss on CUDA against the CPU's. Exit code 77: there is no device or no cuDNN.
//
// The loss has a slope that jumps: where a feature is near zero, or two of a pooling are nearly
// equal, rounding decides which way the gradient goes. A few such features make errors far above
// those of the arithmetic, so gradients are held to a bound of their median over cases and to a
// wide one of the worst.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "backend/cuda/cuda_backend.h"
#include "backend/cuda/memory.h"
#include "catch.h"
#include "catch_runner.h"
#include "perceptual/perceptual_loss.h"
#include "train/colour_correction.h"
#include "train_scene.h"
#include "vgg_fixture.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

constexpr float kWeight = 0.3f;
constexpr ColourMap kMap = {0.9f, 0.05f,  -0.02f, 0.03f, 1.1f,   0.01f,
                            0.0f, -0.04f, 0.95f,  0.02f, -0.01f, 0.03f};

void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

struct Outcome {
  double value = 0;
  std::vector<float> gradient;  // by the rendered colours, planar
  std::vector<float> by_map;    // 12
};

struct Pictures {
  Image rendered;
  Image8 truth;
};

// A rendering that is off by `noise` from a smooth truth.
Pictures pictures(int width, int height, float noise) {
  Pictures made;
  made.truth = random_truth(width, height, 3);
  made.rendered.reshape(width, height, 3);
  std::mt19937 random(11);
  std::normal_distribution<float> normal(0.0f, noise);
  for (std::size_t i = 0; i < made.truth.data.size(); ++i)
    made.rendered.plane(static_cast<int>(i % 3))[i / 3] =
        static_cast<float>(made.truth.data[i]) / 255.0f + normal(random);
  return made;
}

Outcome on_cpu(const Vgg16& network, const Pictures& p, const Patch& patch) {
  Image shown, d_shown;
  apply_colour(kMap, p.rendered, shown);
  d_shown.reshape(shown.width, shown.height, 3);
  std::fill(d_shown.data.begin(), d_shown.data.end(), 0.0f);
  Outcome result;
  result.value = PerceptualLoss(network).evaluate(shown, p.truth, patch, kWeight, d_shown);
  const ColourMap by_map = colour_backward(kMap, p.rendered, d_shown);
  result.by_map.assign(by_map.begin(), by_map.end());
  result.gradient = d_shown.data;
  return result;
}

template <typename T, typename U>
void upload(cuda::DeviceArray<T>& array, const std::vector<U>& values) {
  static_assert(sizeof(T) % sizeof(U) == 0);
  check(array.ensure(values.size() * sizeof(U) / sizeof(T)));
  REQUIRE(cudaMemcpy(array.data(), values.data(), values.size() * sizeof(U),
                     cudaMemcpyHostToDevice) == cudaSuccess);
}

template <typename T>
std::vector<T> download(const T* data, std::size_t n) {
  std::vector<T> values(n);
  REQUIRE(cudaMemcpy(values.data(), data, n * sizeof(T), cudaMemcpyDeviceToHost) == cudaSuccess);
  return values;
}

// Onto gradients that are `before` everywhere.
Outcome on_gpu(cuda::PerceptualNetwork& network, const Pictures& p, const Patch& patch,
               float before = 0.0f) {
  const std::size_t pixels = p.rendered.data.size() / 3;
  std::vector<float> picture(4 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (int c = 0; c < 3; ++c) picture[4 * i + c] = p.rendered.plane(c)[i];
  }
  cuda::DeviceArray<float4> device_picture, d_picture;
  cuda::DeviceArray<std::uint8_t> truth;
  cuda::DeviceArray<float> map, map_sums;
  upload(device_picture, picture);
  upload(d_picture, std::vector<float>(4 * pixels, before));
  upload(truth, p.truth.data);
  upload(map, std::vector<float>(kMap.begin(), kMap.end()));
  upload(map_sums, std::vector<float>(24, before));
  cuda::Stream stream;
  check(stream.create());
  cuda::PerceptualStep step;
  step.image = device_picture.data();
  step.ground_truth = truth.data();
  step.colour_map = map.data();
  step.width = p.rendered.width;
  step.patch = patch;
  step.weight = kWeight;
  step.d_image = d_picture.data();
  step.map_sums = map_sums.data();
  step.map_stride = 2;
  check(network.enqueue(step, stream));
  check(stream.wait());
  Outcome result;
  result.value = download(network.value(), 1)[0];
  const std::vector<float> sums = download(map_sums.data(), 24);
  for (int k = 0; k < 12; ++k) result.by_map.push_back(sums[2 * k] - before);
  const auto* gradient = reinterpret_cast<const float*>(d_picture.data());
  const std::vector<float> d = download(gradient, 4 * pixels);
  result.gradient.resize(3 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (int c = 0; c < 3; ++c) result.gradient[c * pixels + i] = d[4 * i + c] - before;
    CHECK(d[4 * i + 3] == before);
  }
  return result;
}

double difference(const std::vector<float>& a, const std::vector<float>& b) {
  REQUIRE(a.size() == b.size());
  double square = 0, length = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    square += std::pow(double{a[i]} - b[i], 2);
    length += std::pow(double{a[i]}, 2);
  }
  const double share = std::sqrt(square / length);
  return std::isfinite(share) ? share : INFINITY;
}

struct Case {
  int width, height;
  Patch patch;
};

// Whole pictures of even and odd sizes, the least size, patches at a corner and inside.
const Case kCases[] = {
    {96, 64, {0, 0, 96, 64}},    {101, 67, {0, 0, 101, 67}}, {16, 16, {0, 0, 16, 16}},
    {120, 90, {56, 42, 64, 48}}, {120, 90, {7, 3, 35, 18}},
};

std::shared_ptr<const Vgg16> shared_vgg16(unsigned seed, bool linear) {
  return std::make_shared<Vgg16>(random_vgg16(seed, linear));
}

std::unique_ptr<cuda::PerceptualNetwork> network_of(
    const std::shared_ptr<const Vgg16>& vgg,
    cuda::VggPrecision precision = cuda::VggPrecision::kTensorCores) {
  auto network = cuda::make_perceptual_network(vgg, precision);
  check(network.status());
  const Result<std::size_t> bytes = (*network)->bytes(120, 90);
  check(bytes.status());
  CHECK(*bytes > std::size_t{4} * 2 * 14710464);  // the weights, forward and backward
  check((*network)->reserve(120, 90));
  return std::move(*network);
}

}  // namespace

TEST_CASE("the perceptual loss and its gradients are the CPU's") {
  std::vector<double> exact_errors, quick_errors;
  for (const bool linear : {false, true}) {
    const auto vgg = shared_vgg16(2, linear);
    const auto exact = network_of(vgg, cuda::VggPrecision::kFloat), quick = network_of(vgg);
    for (const Case& c : kCases) {
      for (const float noise : {0.3f, 0.03f}) {
        const Pictures p = pictures(c.width, c.height, noise);
        const Outcome expected = on_cpu(*vgg, p, c.patch);
        const Outcome found = on_gpu(*exact, p, c.patch), rough = on_gpu(*quick, p, c.patch);
        for (const auto& [outcome, errors, name] :
             {std::tuple(&found, &exact_errors, "floats"),
              std::tuple(&rough, &quick_errors, "tensor cores")}) {
          errors->push_back(difference(expected.gradient, outcome->gradient));
          errors->push_back(difference(expected.by_map, outcome->by_map));
          std::printf(
              "%dx%d, patch %dx%d, noise %.2f, %s: loss %.7f off by %.1e, gradient %.1e, "
              "colour map %.1e\n",
              c.width, c.height, c.patch.width, c.patch.height, noise, name, expected.value,
              std::abs(outcome->value / expected.value - 1), *(errors->end() - 2), errors->back());
        }
        CHECK(found.value == Approx(expected.value).epsilon(1e-5));
        CHECK(rough.value == Approx(expected.value).epsilon(1e-3));
      }
    }
  }
  for (auto* errors : {&exact_errors, &quick_errors}) std::sort(errors->begin(), errors->end());
  CHECK(exact_errors[exact_errors.size() / 2] <= 1e-3);
  CHECK(exact_errors.back() <= 5e-2);
  CHECK(quick_errors[quick_errors.size() / 2] <= 8e-2);
  CHECK(quick_errors.back() <= 0.25);
}

TEST_CASE("the gradient is added to what is there, and repeats to the bit") {
  const auto vgg = shared_vgg16(3, true);
  const auto network = network_of(vgg), other = network_of(vgg);
  const Case& c = kCases[3];
  const Pictures p = pictures(c.width, c.height, 0.1f);
  const Outcome once = on_gpu(*network, p, c.patch);
  // Other sizes in between.
  on_gpu(*network, p, kCases[4].patch);
  on_gpu(*network, p, {0, 0, 120, 90});
  const Outcome again = on_gpu(*network, p, c.patch), fresh = on_gpu(*other, p, c.patch);
  for (const Outcome* r : {&again, &fresh}) {
    CHECK(r->value == once.value);
    CHECK(r->gradient == once.gradient);
    CHECK(r->by_map == once.by_map);
  }
  const Outcome added = on_gpu(*network, p, c.patch, 1.0f);
  float worst = 0;
  for (std::size_t i = 0; i < once.gradient.size(); ++i)
    worst = std::max(worst, std::abs(added.gradient[i] - once.gradient[i]));
  CHECK(worst <= 2e-7f);
}

TEST_CASE("a step with a perceptual loss has the CPU's losses and gradients") {
  const auto vgg = shared_vgg16(5, true);
  const int width = 160, height = 96;
  const Image8 truth = random_truth(width, height, 1);
  SceneShape shape;
  TrainState cpu = train_state(random_scene(3000, scene_camera(width, height), 5, shape), 3);
  TrainState gpu = cpu, again = cpu;
  StepInput input = train_step(scene_camera(width, height), truth, 9.0f, 2);
  input.weight_l1 = input.weight_ssim = 0.0f;  // so that nothing hides it
  input.weight_lifespan = input.weight_opacity = input.weight_scale = 0.0f;
  input.weight_perceptual = 1.0f;
  input.patch = {31, 17, 100, 64};
  cuda::CudaBackend backend;
  check(backend.create());
  check(backend.check_perceptual());
  const auto reference = make_cpu_backend();
  std::vector<StepOutput> outputs;
  for (TrainState* state : {&cpu, &gpu, &again}) {
    TrainBackend& b = state == &cpu ? *reference : static_cast<TrainBackend&>(backend);
    TrainPlan plan;
    plan.primitives = state->size();
    plan.sh_coefficients = 16;
    plan.width = width;
    plan.height = height;
    plan.perceptual = vgg;
    plan.perceptual_patch = 100;
    check(b.reserve(plan));
    if (state == &gpu || state == &again) {
      auto exact = network_of(vgg, cuda::VggPrecision::kFloat);
      backend.pipeline().set_perceptual(std::move(exact));
    }
    check(b.begin(*state));
    check(b.step(input));
    const auto read = b.read();
    check(read.status());
    check(b.synchronise());
    outputs.push_back(read->front());
  }
  std::printf("a step: L_lpips %.6f (CPU %.6f), loss %.6f (%.6f)\n", outputs[1].perceptual,
              outputs[0].perceptual, outputs[1].loss, outputs[0].loss);
  CHECK(outputs[0].perceptual > 0);
  CHECK(outputs[1].perceptual == Approx(outputs[0].perceptual).epsilon(1e-4));
  CHECK(outputs[1].loss == Approx(outputs[0].loss).epsilon(1e-4));
  CHECK(outputs[1].loss == outputs[2].loss);
  for (int a = 0; a < kAttributes; ++a) {
    const double d = difference(cpu.moments[a].first, gpu.moments[a].first);
    std::printf("  attribute %d: %.1e\n", a, d);
    INFO("attribute " << a);
    CHECK(d <= 1e-2);
    CHECK(gpu.moments[a].first == again.moments[a].first);
  }
  std::vector<float> maps[2];
  for (int k = 0; k < 2; ++k) {
    for (const ColourMap& m : (k == 0 ? cpu : gpu).colour_first)
      maps[k].insert(maps[k].end(), m.begin(), m.end());
  }
  CHECK(difference(maps[0], maps[1]) <= 1e-2);
}

TEST_CASE("the perceptual loss counts in what a plan needs") {
  cuda::CudaBackend backend;
  check(backend.create());
  TrainPlan plan;
  plan.primitives = 2000000000;
  plan.sh_coefficients = 16;
  plan.width = plan.height = 4000;
  plan.perceptual = shared_vgg16(6, false);
  const auto refused = [&](const std::string& text) {
    const Status status = backend.reserve(plan);
    INFO(status.message());
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK(status.message().find(text) != std::string::npos);
  };
  refused("a smaller perceptual_patch (which takes 4");  // GiB of it
  plan.width = plan.height = 5000;
  refused("5000x5000 pixels are too large for cuDNN; use a smaller perceptual_patch");
  plan.primitives = 1000;
  plan.perceptual_patch = 256;
  check(backend.reserve(plan));
}

int main(int argc, char** argv) {
  cuda::CudaBackend backend;
  Status status = backend.create();
  if (status.ok()) status = backend.check_perceptual();
  if (status.code() == StatusCode::kUnsupported || status.code() == StatusCode::kNotBuilt) {
    std::printf("skipped: %s\n", status.message().c_str());
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
