// SPDX-License-Identifier: Apache-2.0
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "catch.h"
#include "perceptual/perceptual_loss.h"
#include "vector_targets.h"
#include "vgg_fixture.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

struct Pair {
  Image shown;
  Image8 truth;
  Patch whole() const { return {0, 0, shown.width, shown.height}; }
};

Pair make_pair(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Pair pair;
  pair.shown.reshape(width, height, 3);
  pair.truth = {width, height, 3, std::vector<std::uint8_t>(3ul * width * height)};
  for (float& v : pair.shown.data) v = uniform(random);
  for (std::uint8_t& v : pair.truth.data) v = static_cast<std::uint8_t>(255.0f * uniform(random));
  return pair;
}

// The definition in double: planar features, each convolution a sum over its window.
struct Planes {
  int width = 0, height = 0, channels = 0;
  std::vector<double> data;
  double& at(int c, int y, int x) { return data[(std::size_t{1} * c * height + y) * width + x]; }
  double at(int c, int y, int x) const {
    return data[(std::size_t{1} * c * height + y) * width + x];
  }
};

Planes planes(int width, int height, int channels) {
  return {width, height, channels, std::vector<double>(std::size_t{1} * width * height * channels)};
}

Planes convolved(const Planes& in, const VggConvolution& convolution, int out_channels) {
  Planes out = planes(in.width, in.height, out_channels);
  for (int o = 0; o < out_channels; ++o) {
    for (int c = 0; c < in.channels; ++c) {
      for (int tap = 0; tap < 9; ++tap) {
        const int dy = tap / 3 - 1, dx = tap % 3 - 1;
        const double w = convolution.weight[(std::size_t{1} * o * in.channels + c) * 9 + tap];
        for (int y = std::max(0, -dy); y < std::min(in.height, in.height - dy); ++y) {
          for (int x = std::max(0, -dx); x < std::min(in.width, in.width - dx); ++x)
            out.at(o, y, x) += w * in.at(c, y + dy, x + dx);
        }
      }
    }
  }
  for (int o = 0; o < out_channels; ++o) {
    for (int y = 0; y < in.height; ++y) {
      for (int x = 0; x < in.width; ++x)
        out.at(o, y, x) = std::max(0.0, out.at(o, y, x) + convolution.bias[o]);
    }
  }
  return out;
}

Planes pooled(const Planes& in) {
  Planes out = planes(in.width / 2, in.height / 2, in.channels);
  for (int c = 0; c < out.channels; ++c) {
    for (int y = 0; y < out.height; ++y) {
      for (int x = 0; x < out.width; ++x) {
        out.at(c, y, x) = std::max({in.at(c, 2 * y, 2 * x), in.at(c, 2 * y, 2 * x + 1),
                                    in.at(c, 2 * y + 1, 2 * x), in.at(c, 2 * y + 1, 2 * x + 1)});
      }
    }
  }
  return out;
}

// The taps' features, scaled to length 1; colours in [0,1], planar.
std::vector<Planes> plain_features(const Vgg16& network, const Planes& colours) {
  std::vector<Planes> taps;
  Planes features = colours;
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < colours.height; ++y) {
      for (int x = 0; x < colours.width; ++x)
        features.at(c, y, x) = (colours.at(c, y, x) - kVggMean[c]) / kVggDeviation[c];
    }
  }
  for (std::size_t i = 0; i < kVggLayers.size(); ++i) {
    if (kVggLayers[i].pool_before) features = pooled(features);
    features = convolved(features, network.convolutions[i], kVggLayers[i].out);
    if (kVggLayers[i].tap < 0) continue;
    Planes scaled = features;
    for (int y = 0; y < scaled.height; ++y) {
      for (int x = 0; x < scaled.width; ++x) {
        double square = kVggEpsilon;
        for (int c = 0; c < scaled.channels; ++c) square += std::pow(features.at(c, y, x), 2);
        for (int c = 0; c < scaled.channels; ++c) scaled.at(c, y, x) /= std::sqrt(square);
      }
    }
    taps.push_back(std::move(scaled));
  }
  return taps;
}

double plain_distance(const Vgg16& network, const std::vector<Planes>& a,
                      const std::vector<Planes>& b) {
  double loss = 0;
  for (int tap = 0; tap < kVggTaps; ++tap) {
    double sum = 0;
    for (int c = 0; c < a[tap].channels; ++c) {
      for (int y = 0; y < a[tap].height; ++y) {
        for (int x = 0; x < a[tap].width; ++x)
          sum += network.channel_weights[tap][c] *
                 std::pow(a[tap].at(c, y, x) - b[tap].at(c, y, x), 2);
      }
    }
    loss += sum / (a[tap].width * a[tap].height);
  }
  return loss;
}

Planes plain(const Image& image) {
  Planes out = planes(image.width, image.height, 3);
  std::copy(image.data.begin(), image.data.end(), out.data.begin());
  return out;
}

Planes plain(const Image8& image) {
  Planes out = planes(image.width, image.height, 3);
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

TEST_CASE("the perceptual loss and its gradient are what the definition says") {
  for (const bool linear : {false, true}) {
    const Vgg16 network = testing::random_vgg16(3, linear);
    PerceptualLoss loss(network);
    // Odd sizes lose a row or column in each pooling; 16 is the least.
    for (const auto& [width, height] : {std::array{16, 16}, std::array{35, 18}}) {
      INFO(width << " x " << height << (linear ? ", linear" : ""));
      const Pair pair = make_pair(width, height, 5);
      const std::vector<Planes> truth = plain_features(network, plain(pair.truth));
      Planes shown = plain(pair.shown);
      const double expected = plain_distance(network, plain_features(network, shown), truth);
      const float weight = 0.25f;
      Image gradient = zeros(width, height);
      const double found = loss.evaluate(pair.shown, pair.truth, pair.whole(), weight, gradient);
      CHECK(found == Approx(expected).epsilon(1e-5));
      double largest = 0;
      for (const float g : gradient.data) largest = std::max(largest, std::abs(double{g}));
      CHECK(largest > 1e-5);
      const std::size_t step = gradient.data.size() / 6 + 1;
      for (std::size_t k = 7; k < shown.data.size(); k += step) {
        const double kept = shown.data[k], delta = 1e-5;
        shown.data[k] = kept + delta;
        const double above = plain_distance(network, plain_features(network, shown), truth);
        shown.data[k] = kept - delta;
        const double below = plain_distance(network, plain_features(network, shown), truth);
        shown.data[k] = kept;
        INFO("value " << k);
        CHECK(gradient.data[k] ==
              Approx(weight * (above - below) / (2 * delta)).margin(1e-3 * largest));
      }
    }
  }
}

TEST_CASE("every vector unit gives one perceptual loss, and threads change no bit of it") {
  const Vgg16 network = testing::random_vgg16(4, true);
  PerceptualLoss loss(network);
  const Pair pair = make_pair(50, 37, 6);
  Image first = zeros(50, 37);
  const double value = loss.evaluate(pair.shown, pair.truth, pair.whole(), 1.0f, first);
  double length = 0;
  for (const float g : first.data) length += double{g} * g;
  testing::for_each_vector_target([&] {
    Image gradient[2] = {zeros(50, 37), zeros(50, 37)};
    double values[2];
    for (std::size_t threads : {1, 2}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      values[threads - 1] =
          loss.evaluate(pair.shown, pair.truth, pair.whole(), 1.0f, gradient[threads - 1]);
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

TEST_CASE("a patch is the cut picture's loss, and its gradient is added there alone") {
  const Vgg16 network = testing::random_vgg16(5, false);
  PerceptualLoss loss(network);
  const Pair pair = make_pair(40, 30, 7);
  const Patch patch{9, 5, 20, 17};
  Pair cut = make_pair(patch.width, patch.height, 8);
  for (int y = 0; y < patch.height; ++y) {
    for (int x = 0; x < patch.width; ++x) {
      const std::size_t from = std::size_t{1} * (patch.y + y) * 40 + patch.x + x;
      const std::size_t to = std::size_t{1} * y * patch.width + x;
      for (int c = 0; c < 3; ++c) {
        cut.shown.plane(c)[to] = pair.shown.plane(c)[from];
        cut.truth.data[3 * to + c] = pair.truth.data[3 * from + c];
      }
    }
  }
  Image gradient = zeros(40, 30), cut_gradient = zeros(patch.width, patch.height);
  std::fill(gradient.data.begin(), gradient.data.end(), 1.0f);
  std::fill(cut_gradient.data.begin(), cut_gradient.data.end(), 1.0f);
  CHECK(loss.evaluate(pair.shown, pair.truth, patch, 2.0f, gradient) ==
        loss.evaluate(cut.shown, cut.truth, cut.whole(), 2.0f, cut_gradient));
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < 30; ++y) {
      for (int x = 0; x < 40; ++x) {
        const int px = x - patch.x, py = y - patch.y;
        const bool inside = px >= 0 && py >= 0 && px < patch.width && py < patch.height;
        const float expected =
            inside ? cut_gradient.plane(c)[std::size_t{1} * py * patch.width + px] : 1.0f;
        CHECK(gradient.plane(c)[std::size_t{1} * y * 40 + x] == expected);
      }
    }
  }
}

TEST_CASE("equal pictures have no perceptual loss and no gradient") {
  const Vgg16 network = testing::random_vgg16(6, true);
  PerceptualLoss loss(network);
  Pair pair = make_pair(24, 20, 9);
  for (std::size_t i = 0; i < pair.truth.data.size(); ++i)
    pair.shown.plane(static_cast<int>(i % 3))[i / 3] =
        static_cast<float>(pair.truth.data[i]) * (1.0f / 255.0f);
  Image gradient = zeros(24, 20);
  CHECK(loss.evaluate(pair.shown, pair.truth, pair.whole(), 1.0f, gradient) == 0.0);
  CHECK(std::all_of(gradient.data.begin(), gradient.data.end(), [](float g) { return g == 0.0f; }));
}

TEST_CASE("patches lie in the picture, everywhere alike, and follow their random numbers") {
  int left = 0;
  for (std::uint64_t iteration = 0; iteration < 400; ++iteration) {
    Random random(1, iteration, RandomPurpose::kPatch);
    Random again(1, iteration, RandomPurpose::kPatch);
    const Patch patch = random_patch(100, 64, 40, random), same = random_patch(100, 64, 40, again);
    CHECK((patch.width == 40 && patch.height == 40));
    CHECK((patch.x >= 0 && patch.x <= 60 && patch.y >= 0 && patch.y <= 24));
    CHECK((patch.x == same.x && patch.y == same.y));
    left += patch.x < 30;
    const Patch low = random_patch(100, 30, 40, random), whole = random_patch(100, 64, 0, random);
    CHECK((low.height == 30 && low.y == 0 && low.width == 40));
    CHECK((whole.width == 100 && whole.height == 64 && whole.x == 0 && whole.y == 0));
  }
  CHECK((left > 150 && left < 250));
}
