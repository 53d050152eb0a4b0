// SPDX-License-Identifier: Apache-2.0
// LPIPS with networks of random weights against its definition in double precision.
#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "catch.h"
#include "fixtures/loop_threads.h"
#include "perceptual/lpips_networks.h"
#include "stgs/encoder/lpips.h"
#include "stgs/format/byte_source.h"
#include "vector_targets.h"
#include "vgg_fixture.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

using Kind = LpipsLayer::Kind;
using Tensors = std::map<std::string, std::pair<std::string, std::vector<float>>>;  // with shapes

// The tensors of a network, whose weights preserve the magnitude of activations.
Tensors random_tensors(const LpipsNetwork& network, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  Tensors out;
  const auto add = [&](const std::string& name, int in, int channels, int size) {
    const float scale = std::sqrt(6.0f / static_cast<float>(size * size * in));
    std::vector<float> weight(std::size_t{1} * channels * in * size * size);
    std::vector<float> bias(static_cast<std::size_t>(channels));
    for (float& w : weight) w = scale * uniform(random);
    for (float& b : bias) b = 0.05f * uniform(random);
    out[name + ".weight"] = {fmt::format("[{},{},{},{}]", channels, in, size, size), weight};
    out[name + ".bias"] = {fmt::format("[{}]", channels), bias};
  };
  int tap = 0;
  for (const LpipsLayer& layer : network.layers) {
    const std::string name = fmt::format("features.{}", layer.feature);
    if (layer.kind == Kind::kConvolution) add(name, layer.in, layer.out, layer.window.size);
    if (layer.kind == Kind::kFire) {
      add(name + ".squeeze", layer.in, layer.squeezed, 1);
      add(name + ".expand1x1", layer.squeezed, layer.out / 2, 1);
      add(name + ".expand3x3", layer.squeezed, layer.out / 2, 3);
    }
    if (!layer.tap) continue;
    std::vector<float> weights(static_cast<std::size_t>(layer.out));
    for (float& w : weights) w = std::abs(uniform(random));
    out[fmt::format("lin{}.model.1.weight", tap++)] = {fmt::format("[1,{},1,1]", layer.out),
                                                       weights};
  }
  return out;
}

Result<std::shared_ptr<const Lpips>> read(const Tensors& tensors) {
  testing::SafetensorsWriter writer;
  for (const auto& [name, tensor] : tensors) writer.add(name, tensor.first, tensor.second);
  return Lpips::read(memory_source(writer.take(), "weights"));
}

// Planar features.
struct Features {
  int width = 0, height = 0, channels = 0;
  std::vector<double> data;
  Features(int w, int h, int c)
      : width(w), height(h), channels(c), data(std::size_t{1} * w * h * c) {}
  double& at(int c, int y, int x) { return data[(std::size_t{1} * c * height + y) * width + x]; }
  double at(int c, int y, int x) const {
    return data[(std::size_t{1} * c * height + y) * width + x];
  }
};

Features convolve(const Features& in, const Tensors& tensors, const std::string& name,
                  const Window& window) {
  const std::vector<float>&weight = tensors.at(name + ".weight").second,
        &bias = tensors.at(name + ".bias").second;
  const int n = window.size;
  const auto count = [&](int pixels) {
    return (pixels + 2 * window.padding - n) / window.stride + 1;
  };
  Features out(count(in.width), count(in.height), static_cast<int>(bias.size()));
  for (int o = 0; o < out.channels; ++o) {
    for (int y = 0; y < out.height; ++y) {
      for (int x = 0; x < out.width; ++x) {
        double sum = bias[static_cast<std::size_t>(o)];
        for (int c = 0; c < in.channels; ++c) {
          for (int k = 0; k < n * n; ++k) {
            const int u = x * window.stride - window.padding + k % n;
            const int v = y * window.stride - window.padding + k / n;
            if (u < 0 || v < 0 || u >= in.width || v >= in.height) continue;
            sum += weight[(std::size_t{1} * o * in.channels + c) * n * n + k] * in.at(c, v, u);
          }
        }
        out.at(o, y, x) = std::max(0.0, sum);
      }
    }
  }
  return out;
}

Features pool(const Features& in, const Window& window) {
  const auto count = [&](int pixels) {
    const double windows = static_cast<double>(pixels - window.size) / window.stride;
    return static_cast<int>(window.ceil ? std::ceil(windows) : std::floor(windows)) + 1;
  };
  Features out(count(in.width), count(in.height), in.channels);
  for (int c = 0; c < out.channels; ++c) {
    for (int y = 0; y < out.height; ++y) {
      for (int x = 0; x < out.width; ++x) {
        const int u = x * window.stride, v = y * window.stride;
        double most = in.at(c, v, u);
        for (int k = 0; k < window.size * window.size; ++k) {
          const int s = u + k % window.size, t = v + k / window.size;
          if (s < in.width && t < in.height) most = std::max(most, in.at(c, t, s));
        }
        out.at(c, y, x) = most;
      }
    }
  }
  return out;
}

Features apply(const Features& in, const LpipsLayer& layer, const Tensors& tensors) {
  const std::string name = fmt::format("features.{}", layer.feature);
  if (layer.kind == Kind::kPooling) return pool(in, layer.window);
  if (layer.kind == Kind::kConvolution) return convolve(in, tensors, name, layer.window);
  const Features squeezed = convolve(in, tensors, name + ".squeeze", {1, 1, 0});
  Features out = convolve(squeezed, tensors, name + ".expand1x1", {1, 1, 0});
  const Features more = convolve(squeezed, tensors, name + ".expand3x3", {});
  out.data.insert(out.data.end(), more.data.begin(), more.data.end());
  out.channels += more.channels;
  return out;
}

double tap_distance(const Features& a, const Features& b, const std::vector<float>& weights) {
  double sum = 0;
  for (int y = 0; y < a.height; ++y) {
    for (int x = 0; x < a.width; ++x) {
      double square_a = 0, square_b = 0;
      for (int c = 0; c < a.channels; ++c) {
        square_a += a.at(c, y, x) * a.at(c, y, x);
        square_b += b.at(c, y, x) * b.at(c, y, x);
      }
      for (int c = 0; c < a.channels; ++c) {
        const double difference = a.at(c, y, x) / (std::sqrt(square_a) + 1e-10) -
                                  b.at(c, y, x) / (std::sqrt(square_b) + 1e-10);
        sum += weights[static_cast<std::size_t>(c)] * difference * difference;
      }
    }
  }
  return sum / (a.width * a.height);
}

Features loaded(const Image& image) {
  constexpr double kShift[] = {-0.030, -0.088, -0.188}, kScale[] = {0.458, 0.448, 0.450};
  Features out(image.width, image.height, 3);
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    const std::size_t c = i / (out.data.size() / 3);
    out.data[i] = (2.0 * image.data[i] - 1.0 - kShift[c]) / kScale[c];
  }
  return out;
}

double expected(const LpipsNetwork& network, const Tensors& tensors, const Image& a,
                const Image& b) {
  Features f = loaded(a), g = loaded(b);
  double out = 0;
  int tap = 0;
  for (const LpipsLayer& layer : network.layers) {
    f = apply(f, layer, tensors);
    g = apply(g, layer, tensors);
    if (layer.tap)
      out += tap_distance(f, g, tensors.at(fmt::format("lin{}.model.1.weight", tap++)).second);
  }
  return out;
}

Image random_image(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Image out;
  out.reshape(width, height, 3);
  for (float& v : out.data) v = uniform(random);
  return out;
}

}  // namespace

TEST_CASE("LPIPS: the distance matches its definition", "[lpips]") {
  for (const LpipsNetwork& network : lpips_networks()) {
    const Tensors tensors = random_tensors(network, 1);
    const auto lpips = read(tensors);
    REQUIRE(lpips.ok());
    CHECK((*lpips)->network() == network.name);
    for (const auto& [width, height] : {std::pair(37, 50), std::pair(64, 33)}) {
      const Image a = random_image(width, height, 2), b = random_image(width, height, 3);
      const double reference = expected(network, tensors, a, b);
      CAPTURE(network.name, width, height, reference);
      CHECK(reference > 0.01);
      testing::for_each_vector_target(
          [&] { CHECK((*lpips)->distance(a, b).value() == Approx(reference).epsilon(1e-5)); });
      CHECK((*lpips)->distance(a, a).value() == 0);
    }
  }
}

TEST_CASE("LPIPS: the distance does not depend on the number of threads", "[lpips]") {
  const auto lpips = read(random_tensors(lpips_networks()[0], 4));
  REQUIRE(lpips.ok());
  const Image a = random_image(160, 90, 5), b = random_image(160, 90, 6);
  const double distance = (*lpips)->distance(a, b).value();
  const testing::LoopThreads one(1);
  CHECK((*lpips)->distance(a, b).value() == distance);
}

TEST_CASE("LPIPS: small images and other files are refused", "[lpips]") {
  for (const LpipsNetwork& network : lpips_networks()) {
    Tensors tensors = random_tensors(network, 1);
    const auto lpips = read(tensors);
    REQUIRE(lpips.ok());
    const Image small = random_image(8, 64, 1);
    const Status status = (*lpips)->distance(small, small).status();
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK(status.message().find("(got 8x64)") != std::string::npos);
    CHECK((*lpips)->check_size(8, 64).message() == status.message());
    CHECK((*lpips)->check_size(64, 64).ok());
    CHECK((*lpips)->working_bytes(64, 64) > 0);
    std::vector<float>& weights = tensors.at("lin2.model.1.weight").second;
    weights[1] = -1.0f;
    CHECK(read(tensors).status().message().find("negative channel weight") != std::string::npos);
    weights[1] = 0.0f;
    std::vector<float>& first = tensors.at("features.0.weight").second;
    std::fill(first.begin(), first.end(), 3e38f);
    const auto large = read(tensors);
    REQUIRE(large.ok());
    const Image image = random_image(64, 64, 1), other = random_image(64, 64, 2);
    CHECK((*large)->distance(image, other).status().code() == StatusCode::kInvalidFile);
    tensors.erase("lin2.model.1.weight");
    const Status missing = read(tensors).status();
    CHECK(missing.code() == StatusCode::kInvalidFile);
    CHECK(missing.message().find("lin2.model.1.weight") != std::string::npos);
    tensors.erase("features.0.weight");
    CHECK(read(tensors).status().message().find("weights: not a network of LPIPS") !=
          std::string::npos);
  }
}
