// SPDX-License-Identifier: Apache-2.0
// LPIPS with networks of random weights against its definition in double precision.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "catch.h"
#include "fixtures/loop_threads.h"
#include "network_fixture.h"
#include "network_reference.h"
#include "perceptual/lpips_networks.h"
#include "stgs/encoder/lpips.h"
#include "stgs/format/byte_source.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder;
using testing::Features;
using testing::random_tensors;
using testing::Tensors;

namespace {

Result<std::shared_ptr<const Lpips>> read(const Tensors& tensors) {
  return Lpips::read(memory_source(testing::tensors_file(tensors), "weights"));
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
    f = testing::apply(f, layer, tensors);
    g = testing::apply(g, layer, tensors);
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
