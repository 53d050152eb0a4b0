// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <array>
#include <cmath>

#include "catch.h"
#include "fixtures/loop_threads.h"
#include "network_reference.h"
#include "perceptual/perceptual_loss.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder;
using testing::Features;
using testing::Tensors;

namespace {

struct Pair {
  Image rendered;
  Image8 ground_truth;
  Patch full() const { return {0, 0, rendered.width, rendered.height}; }
};

Pair make_pair(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Pair pair;
  pair.rendered.reshape(width, height, 3);
  pair.ground_truth = {width, height, 3, std::vector<std::uint8_t>(3ul * width * height)};
  for (float& v : pair.rendered.data) v = uniform(random);
  for (std::uint8_t& v : pair.ground_truth.data)
    v = static_cast<std::uint8_t>(255.0f * uniform(random));
  return pair;
}

// Features of the taps, scaled to unit length at each pixel. `colours` are planar and in [0, 1].
std::vector<Features> reference_features(const LpipsNetwork& network, const Tensors& tensors,
                                         const Features& colours) {
  std::vector<Features> taps;
  Features features = colours;
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < colours.height; ++y) {
      for (int x = 0; x < colours.width; ++x)
        features.at(c, y, x) = (colours.at(c, y, x) - kInputMean[c]) / kInputDeviation[c];
    }
  }
  for (const LpipsLayer& layer : network.layers) {
    features = testing::apply(features, layer, tensors);
    if (!layer.tap) continue;
    Features scaled = features;
    for (int y = 0; y < scaled.height; ++y) {
      for (int x = 0; x < scaled.width; ++x) {
        double square = kSquareEpsilon;
        for (int c = 0; c < scaled.channels; ++c) square += std::pow(features.at(c, y, x), 2);
        for (int c = 0; c < scaled.channels; ++c) scaled.at(c, y, x) /= std::sqrt(square);
      }
    }
    taps.push_back(std::move(scaled));
  }
  return taps;
}

double reference_loss(const Tensors& tensors, const std::vector<Features>& a,
                      const std::vector<Features>& b) {
  double loss = 0;
  for (std::size_t tap = 0; tap < a.size(); ++tap) {
    const auto weights = tensors.find(fmt::format("lin{}.model.1.weight", tap));
    double sum = 0;
    for (int c = 0; c < a[tap].channels; ++c) {
      const double weight =
          weights == tensors.end() ? 1.0 / a[tap].channels : double{weights->second.second[c]};
      for (int y = 0; y < a[tap].height; ++y) {
        for (int x = 0; x < a[tap].width; ++x)
          sum += weight * std::pow(a[tap].at(c, y, x) - b[tap].at(c, y, x), 2);
      }
    }
    loss += sum / (a[tap].width * a[tap].height);
  }
  return loss;
}

Features to_features(const Image& image) {
  Features out(image.width, image.height, 3);
  std::copy(image.data.begin(), image.data.end(), out.data.begin());
  return out;
}

Features to_features(const Image8& image) {
  Features out(image.width, image.height, 3);
  for (std::size_t i = 0; i < image.data.size(); ++i)
    out.data[i % 3 * (image.data.size() / 3) + i / 3] = image.data[i] / 255.0;
  return out;
}

Image zeros(int width, int height) {
  Image image;
  image.reshape(width, height, 3);
  return image;
}

}  // namespace

TEST_CASE("the perceptual loss and its gradient match the definition") {
  struct Case {
    const char* network;
    bool linear;
    int width, height;
  };
  // Poolings drop or clip the last row or column of some sizes; the first sizes are the smallest.
  const Case cases[] = {{"vgg", false, 16, 16},     {"vgg", true, 35, 18},
                        {"squeeze", false, 25, 25}, {"squeeze", true, 38, 27},
                        {"alex", false, 31, 31},    {"alex", true, 45, 40}};
  for (const Case& c : cases) {
    INFO(c.network << ", " << c.width << " x " << c.height << (c.linear ? ", linear" : ""));
    const LpipsNetwork network = testing::network_layout(c.network);
    const Tensors tensors = testing::random_tensors(network, 3, c.linear);
    const auto weights = testing::network_of(tensors);
    CHECK(weights->linear == c.linear);
    if (c.width == c.height) CHECK(weights->min_side() == c.width);
    PerceptualLoss loss(weights);
    const Pair pair = make_pair(c.width, c.height, 5);
    const std::vector<Features> ground_truth =
        reference_features(network, tensors, to_features(pair.ground_truth));
    Features rendered = to_features(pair.rendered);
    const auto reference = [&] {
      return reference_loss(tensors, reference_features(network, tensors, rendered), ground_truth);
    };
    const double expected = reference();
    const float weight = 0.25f;
    Image gradient = zeros(c.width, c.height);
    const double found =
        loss.evaluate(pair.rendered, pair.ground_truth, pair.full(), weight, gradient);
    CHECK(found == Approx(expected).epsilon(1e-5));
    double largest = 0;
    for (const float g : gradient.data) largest = std::max(largest, std::abs(double{g}));
    CHECK(largest > 1e-5);
    const std::size_t step = gradient.data.size() / 6 + 1;
    for (std::size_t k = 7; k < rendered.data.size(); k += step) {
      const double original = rendered.data[k], delta = 1e-5;
      rendered.data[k] = original + delta;
      const double above = reference();
      rendered.data[k] = original - delta;
      const double below = reference();
      rendered.data[k] = original;
      INFO("value " << k);
      CHECK(gradient.data[k] ==
            Approx(weight * (above - below) / (2 * delta)).margin(1e-3 * largest));
    }
  }
}

TEST_CASE(
    "every vector target gives the same perceptual loss, and the number of threads changes no bit "
    "of it") {
  PerceptualLoss loss(testing::random_network("squeeze", 4, true));
  const Pair pair = make_pair(50, 37, 6);
  Image first = zeros(50, 37);
  const double value = loss.evaluate(pair.rendered, pair.ground_truth, pair.full(), 1.0f, first);
  double length = 0;
  for (const float g : first.data) length += double{g} * g;
  testing::for_each_vector_target([&] {
    Image gradient[2] = {zeros(50, 37), zeros(50, 37)};
    double values[2];
    for (int threads : {1, 2}) {
      const testing::LoopThreads limit(threads);
      values[threads - 1] =
          loss.evaluate(pair.rendered, pair.ground_truth, pair.full(), 1.0f, gradient[threads - 1]);
    }
    CHECK(values[0] == values[1]);
    CHECK(gradient[0].data == gradient[1].data);
    CHECK(values[0] == Approx(value).epsilon(1e-5));
    double difference = 0;
    for (std::size_t i = 0; i < first.data.size(); ++i)
      difference += std::pow(double{first.data[i]} - gradient[0].data[i], 2);
    CHECK(std::sqrt(difference / length) < 1e-4);
  });
}

TEST_CASE(
    "the loss of a patch is that of the cropped images, and its gradient is added inside the patch "
    "only") {
  PerceptualLoss loss(testing::random_network("vgg", 5, false));
  const Pair pair = make_pair(40, 30, 7);
  const Patch patch{9, 5, 20, 17};
  Pair crop = make_pair(patch.width, patch.height, 8);
  for (int y = 0; y < patch.height; ++y) {
    for (int x = 0; x < patch.width; ++x) {
      const std::size_t from = std::size_t{1} * (patch.y + y) * 40 + patch.x + x;
      const std::size_t to = std::size_t{1} * y * patch.width + x;
      for (int c = 0; c < 3; ++c) {
        crop.rendered.plane(c)[to] = pair.rendered.plane(c)[from];
        crop.ground_truth.data[3 * to + c] = pair.ground_truth.data[3 * from + c];
      }
    }
  }
  Image gradient = zeros(40, 30), crop_gradient = zeros(patch.width, patch.height);
  std::fill(gradient.data.begin(), gradient.data.end(), 1.0f);
  std::fill(crop_gradient.data.begin(), crop_gradient.data.end(), 1.0f);
  CHECK(loss.evaluate(pair.rendered, pair.ground_truth, patch, 2.0f, gradient) ==
        loss.evaluate(crop.rendered, crop.ground_truth, crop.full(), 2.0f, crop_gradient));
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < 30; ++y) {
      for (int x = 0; x < 40; ++x) {
        const int px = x - patch.x, py = y - patch.y;
        const bool inside = px >= 0 && py >= 0 && px < patch.width && py < patch.height;
        const float expected =
            inside ? crop_gradient.plane(c)[std::size_t{1} * py * patch.width + px] : 1.0f;
        CHECK(gradient.plane(c)[std::size_t{1} * y * 40 + x] == expected);
      }
    }
  }
}

TEST_CASE("equal images have no perceptual loss and no gradient") {
  PerceptualLoss loss(testing::random_network("alex", 6, true));
  Pair pair = make_pair(34, 31, 9);
  for (std::size_t i = 0; i < pair.ground_truth.data.size(); ++i)
    pair.rendered.plane(static_cast<int>(i % 3))[i / 3] =
        static_cast<float>(pair.ground_truth.data[i]) * (1.0f / 255.0f);
  Image gradient = zeros(34, 31);
  CHECK(loss.evaluate(pair.rendered, pair.ground_truth, pair.full(), 1.0f, gradient) == 0.0);
  CHECK(std::all_of(gradient.data.begin(), gradient.data.end(), [](float g) { return g == 0.0f; }));
}

TEST_CASE(
    "random patches lie inside the image, are uniform, and depend only on their random numbers") {
  int left = 0;
  for (std::uint64_t iteration = 0; iteration < 400; ++iteration) {
    Random random(1, iteration, RandomPurpose::kPatch);
    Random again(1, iteration, RandomPurpose::kPatch);
    const Patch patch = random_patch(100, 64, 40, random), same = random_patch(100, 64, 40, again);
    CHECK((patch.width == 40 && patch.height == 40));
    CHECK((patch.x >= 0 && patch.x <= 60 && patch.y >= 0 && patch.y <= 24));
    CHECK((patch.x == same.x && patch.y == same.y));
    left += patch.x < 30;
    const Patch low = random_patch(100, 30, 40, random),
                unlimited = random_patch(100, 64, 0, random);
    CHECK((low.height == 30 && low.y == 0 && low.width == 40));
    CHECK(
        (unlimited.width == 100 && unlimited.height == 64 && unlimited.x == 0 && unlimited.y == 0));
  }
  CHECK((left > 150 && left < 250));
}
