// SPDX-License-Identifier: Apache-2.0
// Compares the perceptual loss on CUDA with the CPU. Exit code 77: no device or no cuDNN found.
//
// The gradient is discontinuous: where a feature is near zero, or two inputs of a pooling are
// nearly equal, rounding decides its direction. A few of these features cause errors far above
// those of the arithmetic, so the tests bound the median gradient error over all cases tightly and
// the largest loosely.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "backend/cuda/cuda_backend.h"
#include "backend/cuda/memory.h"
#include "catch.h"
#include "catch_runner.h"
#include "network_fixture.h"
#include "perceptual/perceptual_loss.h"
#include "train/colour_correction.h"
#include "train_scene.h"

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

struct LossResult {
  double value = 0;
  std::vector<float> gradient;      // with respect to the rendered colours, planar
  std::vector<float> map_gradient;  // 12 values
};

struct ImagePair {
  Image rendered;
  Image8 ground_truth;
};

// A smooth ground truth, and a rendering with normal noise of deviation `noise`.
ImagePair make_images(int width, int height, float noise) {
  ImagePair images;
  images.ground_truth = random_ground_truth(width, height, 3);
  images.rendered.reshape(width, height, 3);
  std::mt19937 random(11);
  std::normal_distribution<float> normal(0.0f, noise);
  for (std::size_t i = 0; i < images.ground_truth.data.size(); ++i)
    images.rendered.plane(static_cast<int>(i % 3))[i / 3] =
        static_cast<float>(images.ground_truth.data[i]) / 255.0f + normal(random);
  return images;
}

using SharedNetwork = std::shared_ptr<const FeatureNetwork>;

LossResult evaluate_on_cpu(const SharedNetwork& network, const ImagePair& p, const Patch& patch) {
  Image corrected, d_corrected;
  apply_colour(kMap, p.rendered, corrected);
  d_corrected.reshape(corrected.width, corrected.height, 3);
  std::fill(d_corrected.data.begin(), d_corrected.data.end(), 0.0f);
  LossResult result;
  result.value =
      PerceptualLoss(network).evaluate(corrected, p.ground_truth, patch, kWeight, d_corrected);
  const ColourMap map_gradient = colour_backward(kMap, p.rendered, d_corrected);
  result.map_gradient.assign(map_gradient.begin(), map_gradient.end());
  result.gradient = d_corrected.data;
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

// Adds to gradients that are `before` everywhere.
LossResult evaluate_on_gpu(cuda::PerceptualNetwork& network, const ImagePair& p, const Patch& patch,
                           float before = 0.0f) {
  const std::size_t pixels = p.rendered.data.size() / 3;
  std::vector<float> image(4 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (int c = 0; c < 3; ++c) image[4 * i + c] = p.rendered.plane(c)[i];
  }
  cuda::DeviceArray<float4> device_image, d_image;
  cuda::DeviceArray<std::uint8_t> ground_truth;
  cuda::DeviceArray<float> map, map_sums;
  upload(device_image, image);
  upload(d_image, std::vector<float>(4 * pixels, before));
  upload(ground_truth, p.ground_truth.data);
  upload(map, std::vector<float>(kMap.begin(), kMap.end()));
  upload(map_sums, std::vector<float>(24, before));
  cuda::Stream stream;
  check(stream.create());
  cuda::PerceptualStep step;
  step.image = device_image.data();
  step.ground_truth = ground_truth.data();
  step.colour_map = map.data();
  step.width = p.rendered.width;
  step.patch = patch;
  step.weight = kWeight;
  step.d_image = d_image.data();
  step.map_sums = map_sums.data();
  step.map_stride = 2;
  check(network.enqueue(step, stream));
  check(stream.wait());
  LossResult result;
  result.value = download(network.value(), 1)[0];
  const std::vector<float> sums = download(map_sums.data(), 24);
  for (int k = 0; k < 12; ++k) result.map_gradient.push_back(sums[2 * k] - before);
  const auto* gradient = reinterpret_cast<const float*>(d_image.data());
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
  const double relative = std::sqrt(square / length);
  return std::isfinite(relative) ? relative : INFINITY;
}

struct Case {
  int width, height;
  Patch patch;
};

const Case kPatchInside = {120, 90, {56, 42, 64, 48}};

// Complete images of even and odd sizes and of the minimum sizes of the networks; patches at a
// corner and inside.
const Case kCases[] = {
    {96, 64, {0, 0, 96, 64}},  {101, 67, {0, 0, 101, 67}}, {16, 16, {0, 0, 16, 16}},
    {25, 25, {0, 0, 25, 25}},  {31, 31, {0, 0, 31, 31}},   kPatchInside,
    {120, 90, {7, 3, 35, 18}},
};

std::unique_ptr<cuda::PerceptualNetwork> on_gpu(
    const SharedNetwork& weights,
    cuda::ConvolutionPrecision precision = cuda::ConvolutionPrecision::kTensorCores) {
  auto network = cuda::make_perceptual_network(weights, precision);
  check(network.status());
  const Result<std::size_t> bytes = (*network)->bytes(120, 90);
  check(bytes.status());
  std::size_t values = 0;
  for (const FeatureStage& stage : weights->stages)
    values += (stage.window.stride == 1 ? 2 : 1) * stage.weight.size();  // forward and backward
  CHECK(*bytes > 4 * values);
  check((*network)->reserve(120, 90));
  return std::move(*network);
}

}  // namespace

TEST_CASE("the perceptual loss and its gradients on CUDA match the CPU") {
  std::vector<double> float_errors, tensor_core_errors;
  for (const auto& [name_of_network, linear] :
       {std::pair("vgg", false), std::pair("vgg", true), std::pair("squeeze", true),
        std::pair("alex", true)}) {
    const SharedNetwork weights = random_network(name_of_network, 2, linear);
    const auto float_network = on_gpu(weights, cuda::ConvolutionPrecision::kFloat),
               tensor_core_network = on_gpu(weights);
    for (const Case& c : kCases) {
      if (!weights->accepts(c.patch.width, c.patch.height)) continue;
      for (const float noise : {0.3f, 0.03f}) {
        const ImagePair p = make_images(c.width, c.height, noise);
        const LossResult expected = evaluate_on_cpu(weights, p, c.patch);
        const LossResult found = evaluate_on_gpu(*float_network, p, c.patch),
                         found_tensor_core = evaluate_on_gpu(*tensor_core_network, p, c.patch);
        for (const auto& [outcome, errors, name] :
             {std::tuple(&found, &float_errors, "floats"),
              std::tuple(&found_tensor_core, &tensor_core_errors, "tensor cores")}) {
          errors->push_back(difference(expected.gradient, outcome->gradient));
          errors->push_back(difference(expected.map_gradient, outcome->map_gradient));
          std::printf(
              "%s, %dx%d, patch %dx%d, noise %.2f, %s: loss %.7f off by %.1e, gradient %.1e, "
              "colour map %.1e\n",
              name_of_network, c.width, c.height, c.patch.width, c.patch.height, noise, name,
              expected.value, std::abs(outcome->value / expected.value - 1), *(errors->end() - 2),
              errors->back());
        }
        CHECK(found.value == Approx(expected.value).epsilon(1e-5));
        CHECK(found_tensor_core.value == Approx(expected.value).epsilon(1e-3));
      }
    }
  }
  for (auto* errors : {&float_errors, &tensor_core_errors})
    std::sort(errors->begin(), errors->end());
  CHECK(float_errors[float_errors.size() / 2] <= 1e-3);
  CHECK(float_errors.back() <= 5e-2);
  CHECK(tensor_core_errors[tensor_core_errors.size() / 2] <= 8e-2);
  CHECK(tensor_core_errors.back() <= 0.25);
}

TEST_CASE("the gradient is added to the existing one and repeats to the bit") {
  const SharedNetwork weights = random_network("squeeze", 3, true);
  const auto network = on_gpu(weights), other = on_gpu(weights);
  const Case& c = kPatchInside;
  const ImagePair p = make_images(c.width, c.height, 0.1f);
  const LossResult once = evaluate_on_gpu(*network, p, c.patch);
  // Other sizes in between must not matter.
  evaluate_on_gpu(*network, p, {7, 3, 35, 28});
  evaluate_on_gpu(*network, p, {0, 0, 120, 90});
  const LossResult again = evaluate_on_gpu(*network, p, c.patch),
                   fresh = evaluate_on_gpu(*other, p, c.patch);
  for (const LossResult* r : {&again, &fresh}) {
    CHECK(r->value == once.value);
    CHECK(r->gradient == once.gradient);
    CHECK(r->map_gradient == once.map_gradient);
  }
  const LossResult added = evaluate_on_gpu(*network, p, c.patch, 1.0f);
  float worst = 0;
  for (std::size_t i = 0; i < once.gradient.size(); ++i)
    worst = std::max(worst, std::abs(added.gradient[i] - once.gradient[i]));
  CHECK(worst <= 2e-7f);
}

TEST_CASE("a CUDA step with a perceptual loss has the losses and gradients of the CPU") {
  const SharedNetwork weights = random_network("vgg", 5, true);
  const int width = 160, height = 96;
  const Image8 ground_truth = random_ground_truth(width, height, 1);
  SceneShape shape;
  TrainState cpu = train_state(random_scene(3000, scene_camera(width, height), 5, shape), 3);
  TrainState gpu = cpu, again = cpu;
  StepInput input = train_step(scene_camera(width, height), ground_truth, 9.0f, 2);
  input.weight_l1 = input.weight_ssim = 0.0f;  // the perceptual term alone
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
    plan.perceptual = weights;
    plan.perceptual_patch = 100;
    check(b.reserve(plan));
    if (state == &gpu || state == &again) {
      auto float_network = on_gpu(weights, cuda::ConvolutionPrecision::kFloat);
      backend.pipeline().set_perceptual(std::move(float_network));
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

TEST_CASE("the memory of the perceptual loss counts towards the plan") {
  cuda::CudaBackend backend;
  check(backend.create());
  TrainPlan plan;
  plan.primitives = 2000000000;
  plan.sh_coefficients = 16;
  plan.width = plan.height = 4000;
  plan.perceptual = random_network("vgg", 6, false);
  const auto check_rejected = [&](const std::string& text) {
    const Status status = backend.reserve(plan);
    INFO(status.message());
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK(status.message().find(text) != std::string::npos);
  };
  check_rejected("a smaller perceptual_patch (which takes 4");  // GiB
  plan.width = plan.height = 5000;
  check_rejected("5000x5000 pixels are too large for cuDNN; use a smaller perceptual_patch");
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
