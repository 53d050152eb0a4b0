// SPDX-License-Identifier: Apache-2.0
// Random numbers that are a pure function of (seed, iteration, purpose), so that an interrupted
// training resumes exactly without saved generator state.
#pragma once

#include <cmath>
#include <cstdint>

#include "stgs/format/math/lang.h"

namespace stgs::encoder {

enum class RandomPurpose : std::uint64_t {
  kInitial = 1,
  kViews = 2,
  kDensify = 3,
  kPatch = 4,
  kDrop = 5,
  kStatic = 6,
  kStereo = 7,
  kBackground = 8,
  kRelocation = 9
};

class Random {
 public:
  // Calls of bits() per normal().
  static constexpr std::uint32_t kNormalDraws = 2;

  STGS_FN Random(std::uint64_t seed, std::uint64_t iteration, RandomPurpose purpose)
      : state_(mix(mix(mix(seed) + iteration) + static_cast<std::uint64_t>(purpose))) {}

  STGS_FN std::uint64_t bits() {
    state_ += kStep;
    return mix(state_);
  }
  // Advances as if bits() had been called n times.
  STGS_FN void skip(std::uint64_t n) { state_ += n * kStep; }
  // Uniform in [0, n), n > 0; the bias of the modulus is below 2^-32 for the sizes used here.
  STGS_FN std::uint64_t below(std::uint64_t n) { return bits() % n; }
  // Uniform in [0, 1).
  STGS_FN float uniform() { return static_cast<float>(bits() >> 40) * 0x1p-24f; }
  // Standard normal (Box and Muller).
  STGS_FN float normal() {
    const float radius = std::sqrt(-2.0f * std::log(1.0f - uniform()));
    return radius * std::cos(6.28318530717958648f * uniform());
  }

 private:
  static constexpr std::uint64_t kStep = 0x9E3779B97F4A7C15u;

  // The finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
  STGS_FN static std::uint64_t mix(std::uint64_t x) {
    x += kStep;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
    return x ^ (x >> 31);
  }

  std::uint64_t state_;
};

// Returns whether a step drops primitive i. Primitives are dropped independently, with the given
// probability.
STGS_FN bool dropped(Random random, float probability, std::uint32_t i) {
  random.skip(i);
  return random.uniform() < probability;
}

}  // namespace stgs::encoder
