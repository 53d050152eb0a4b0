// SPDX-License-Identifier: Apache-2.0
#include "bench_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "stgs/format/math/sh.h"

namespace stgs::tools {
namespace {

constexpr std::uint32_t kFrames = 300, kRate = 30;
constexpr double kShortShare = 0.3;
constexpr float kShortSigma = 3, kLongSigma = 900, kAnimatedRadius = 1e-6f;  // frames
constexpr double kAnimatedSpeed = 1e-3;  // maximum, scene units per frame and axis
constexpr float kCutSigma = 0.02f;       // frames: a sharp end of the lifespan
constexpr double kShDeviation = 0.02;    // standard deviation of random coefficients

// Returns a uniform value in [0, 1), the same on every machine.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}

// Returns a standard normal value, the same on every machine up to rounding of the math library.
double normal(std::mt19937_64& random) {
  const double radius = std::sqrt(-2 * std::log(1 - uniform(random)));
  return radius * std::cos(2 * std::numbers::pi * uniform(random));
}

void set_time(Scene& scene) {
  scene.metadata.time_base = {1, kRate};
  scene.metadata.frames = kFrames;
  scene.parts.clear();
}

}  // namespace

void animate(Scene& scene, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Gaussians4D& set = scene.gaussians;
  set_time(scene);
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.time[i] = static_cast<float>(uniform(random) * kFrames);
    set.sigma[i] = uniform(random) < kShortShare ? kShortSigma : kLongSigma;
    set.radius[i] = kAnimatedRadius;
    for (int axis = 0; axis < 3; ++axis) {
      set.velocity[3 * i + axis] = static_cast<float>((2 * uniform(random) - 1) * kAnimatedSpeed);
    }
  }
}

void multiply_stored(Scene& scene, int ratio, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  set_time(scene);
  const auto each = static_cast<std::size_t>(ratio);
  std::vector<std::uint32_t> origin(scene.gaussians.size() * each);
  for (std::size_t k = 0; k < origin.size(); ++k) origin[k] = static_cast<std::uint32_t>(k / each);
  Gaussians4D set = scene.gaussians.gather(origin);
  // The first lifespan begins before the clip and the last ends after it.
  constexpr double kBegin = -1, kEnd = kFrames + 1.0;
  const double length = ratio > 1 ? static_cast<double>(kFrames) / (ratio - 1) : kEnd;
  for (std::size_t k = 0; k < set.size(); k += each) {
    const double shift = uniform(random) * length;
    double begin = kBegin;
    for (std::size_t part = 0; part < each; ++part) {
      const double end = part + 1 == each ? kEnd : shift + static_cast<double>(part) * length;
      set.time[k + part] = static_cast<float>(0.5 * (begin + end));
      set.radius[k + part] = static_cast<float>(0.5 * (end - begin));
      set.sigma[k + part] = kCutSigma;
      begin = end;
    }
  }
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  scene.gaussians = std::move(set);
}

void extend_sh(Gaussians4D& set, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto stored = 3 * static_cast<std::size_t>(set.sh_coefficients());
  set.sh_degree = math::kShMaxDegree;
  const auto needed = 3 * static_cast<std::size_t>(set.sh_coefficients());
  FloatArray sh(needed * set.size());
  for (std::size_t i = 0; i < set.size(); ++i) {
    for (std::size_t k = 0; k < needed; ++k) {
      sh[needed * i + k] =
          k < stored ? set.sh[stored * i + k] : static_cast<float>(kShDeviation * normal(random));
    }
  }
  set.sh.swap(sh);
}

}  // namespace stgs::tools
