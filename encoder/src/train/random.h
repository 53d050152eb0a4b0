// SPDX-License-Identifier: Apache-2.0
// Random numbers that are a pure function of (seed, iteration, purpose), so that an interrupted
// training goes on exactly where it stopped without any generator state to keep.
#pragma once

#include <cmath>
#include <cstdint>

namespace stgs::encoder {

enum class RandomPurpose : std::uint64_t { kInitial = 1, kViews = 2, kDensify = 3 };

class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t iteration, RandomPurpose purpose)
      : state_(mix(mix(mix(seed) + iteration) + static_cast<std::uint64_t>(purpose))) {}

  std::uint64_t bits() {
    state_ += kStep;
    return mix(state_);
  }
  // Uniform in [0, n), n > 0; the bias of the modulus is below 2^-32 for the sizes used here.
  std::uint64_t below(std::uint64_t n) { return bits() % n; }
  // Uniform in [0, 1).
  float uniform() { return static_cast<float>(bits() >> 40) * 0x1p-24f; }
  // Standard normal (Box and Muller).
  float normal() {
    const float radius = std::sqrt(-2.0f * std::log(1.0f - uniform()));
    return radius * std::cos(6.28318530717958648f * uniform());
  }

 private:
  static constexpr std::uint64_t kStep = 0x9E3779B97F4A7C15u;

  // The finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
  static std::uint64_t mix(std::uint64_t x) {
    x += kStep;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
    return x ^ (x >> 31);
  }

  std::uint64_t state_;
};

}  // namespace stgs::encoder
