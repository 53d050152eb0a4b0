// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <random>

#include "catch.h"
#include "fixtures/loop_threads.h"
#include "train/image_loss.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

struct Pair {
  Image rendered;
  Image8 ground_truth;
};

// A smooth, noisy ground truth, and a rendering with more noise.
Pair make_pair(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  Pair pair;
  pair.rendered.reshape(width, height, 3);
  pair.ground_truth = {width, height, 3, std::vector<std::uint8_t>(3ul * width * height)};
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const std::size_t p = static_cast<std::size_t>(y) * width + x;
        const float smooth = 0.5f + 0.3f * std::sin(0.2f * static_cast<float>(x + c * y));
        const float value = std::clamp(smooth + 0.05f * normal(random), 0.0f, 1.0f);
        pair.ground_truth.data[3 * p + c] = static_cast<std::uint8_t>(std::lround(255.0f * value));
        pair.rendered.plane(c)[p] = value + 0.1f * normal(random);
      }
    }
  }
  return pair;
}

// SSIM by its definition, window by window, in double precision.
double reference_ssim(const Pair& pair, int c, int px, int py) {
  const int w = pair.rendered.width, h = pair.rendered.height;
  double total = 0, mx = 0, my = 0, xx = 0, yy = 0, xy = 0;
  for (int j = -5; j <= 5; ++j) {
    for (int i = -5; i <= 5; ++i) {
      const double weight = std::exp(-(i * i + j * j) / 4.5);
      total += weight;
      if (px + i < 0 || px + i >= w || py + j < 0 || py + j >= h) continue;
      const std::size_t p = static_cast<std::size_t>(py + j) * w + px + i;
      const double x = pair.rendered.plane(c)[p], y = pair.ground_truth.data[3 * p + c] / 255.0;
      mx += weight * x;
      my += weight * y;
      xx += weight * x * x;
      yy += weight * y * y;
      xy += weight * x * y;
    }
  }
  for (double* sum : {&mx, &my, &xx, &yy, &xy}) *sum /= total;
  const double c1 = 1e-4, c2 = 9e-4;
  return (2 * mx * my + c1) * (2 * (xy - mx * my) + c2) /
         ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2));
}

struct ReferenceLoss {
  double loss = 0, l1 = 0, mse = 0, ssim = 0;
  std::vector<double> error;
};

ReferenceLoss reference_loss(const Pair& pair, const ImageLossWeights& weights) {
  const int w = pair.rendered.width, h = pair.rendered.height;
  ReferenceLoss reference;
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * w + x;
      double mean = 0;
      for (int c = 0; c < 3; ++c) {
        const double difference =
            pair.rendered.plane(c)[p] - pair.ground_truth.data[3 * p + c] / 255.0;
        reference.l1 += std::abs(difference);
        reference.mse += difference * difference;
        mean += reference_ssim(pair, c, x, y) / 3;
      }
      reference.ssim += mean;
      reference.error.push_back(std::clamp(1.0 - mean, 0.0, 1.0));
    }
  }
  reference.l1 /= 3.0 * w * h;
  reference.mse /= 3.0 * w * h;
  reference.ssim /= 1.0 * w * h;
  reference.loss = weights.l1 * reference.l1 + weights.ssim * (1.0 - reference.ssim);
  return reference;
}

}  // namespace

namespace {

void compare_with_definition() {
  ImageLoss loss;
  Image gradient, error;
  for (const auto& size : {std::array{33, 20}, std::array{16, 11}, std::array{3, 2},
                           std::array{61, 37}, std::array{33, 20}}) {
    const Pair pair = make_pair(size[0], size[1], 1);
    const ImageLossWeights weights{0.8f, 0.2f};
    const ReferenceLoss reference = reference_loss(pair, weights);
    const ImageLossValue value =
        loss.evaluate(pair.rendered, pair.ground_truth, weights, gradient, error);
    INFO(size[0] << " x " << size[1]);
    CHECK(value.loss == Approx(reference.loss).epsilon(1e-4));
    CHECK(value.l1 == Approx(reference.l1).epsilon(1e-5));
    CHECK(value.mse == Approx(reference.mse).epsilon(1e-5));
    CHECK(value.ssim == Approx(reference.ssim).epsilon(1e-4));
    float worst = 0;
    for (std::size_t p = 0; p < reference.error.size(); ++p)
      worst = std::max(worst, std::abs(error.data[p] - static_cast<float>(reference.error[p])));
    CHECK(worst < 1e-3f);
  }
}

}  // namespace

TEST_CASE("the image loss matches its definition at every size and on every vector target") {
  testing::for_each_vector_target(compare_with_definition);
}

TEST_CASE("the gradient of the image loss matches finite differences") {
  ImageLoss loss;
  Image gradient, error;
  for (const ImageLossWeights weights :
       {ImageLossWeights{0.8f, 0.2f}, ImageLossWeights{0.0f, 1.0f}}) {
    Pair pair = make_pair(19, 14, 2);
    loss.evaluate(pair.rendered, pair.ground_truth, weights, gradient, error);
    double largest = 0;
    for (float g : gradient.data) largest = std::max(largest, std::abs(static_cast<double>(g)));
    for (std::size_t k = 0; k < pair.rendered.data.size(); k += 7) {
      const float original = pair.rendered.data[k], step = 2e-4f;
      pair.rendered.data[k] = original + step;
      const double high = pair.rendered.data[k], above = reference_loss(pair, weights).loss;
      pair.rendered.data[k] = original - step;
      const double low = pair.rendered.data[k], below = reference_loss(pair, weights).loss;
      pair.rendered.data[k] = original;
      INFO("value " << k);
      CHECK(gradient.data[k] == Approx((above - below) / (high - low)).margin(2e-3 * largest));
    }
  }
}

TEST_CASE("equal images have no loss, and the number of threads changes no bit of it") {
  Pair pair = make_pair(130, 75, 3);
  ImageLoss loss;
  Image gradient[2], error[2];
  ImageLossValue value[2];
  for (int threads : {1, 2}) {
    const testing::LoopThreads limit(threads);
    value[threads - 1] = loss.evaluate(pair.rendered, pair.ground_truth, {}, gradient[threads - 1],
                                       error[threads - 1]);
  }
  CHECK(value[0].loss == value[1].loss);
  CHECK(gradient[0].data == gradient[1].data);
  CHECK(error[0].data == error[1].data);

  for (int c = 0; c < 3; ++c) {
    for (std::size_t p = 0; p < pair.ground_truth.data.size() / 3; ++p)
      pair.rendered.plane(c)[p] = static_cast<float>(pair.ground_truth.data[3 * p + c]) / 255.0f;
  }
  const ImageLossValue none =
      loss.evaluate(pair.rendered, pair.ground_truth, {}, gradient[0], error[0]);
  CHECK(none.loss == Approx(0.0).margin(1e-5));
  CHECK(none.ssim == Approx(1.0).epsilon(1e-5));
}
