// SPDX-License-Identifier: Apache-2.0
#include "train/rounding.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/quant.h"

namespace stgs::encoder {
namespace {

// Limits of the bits that a coefficient near 0 takes per step.
constexpr double kMinBits = 0.5, kMaxBits = 8.0;

float size_of(Step step) {
  return std::ldexp(static_cast<float>(step.multiplier), step.exponent);
}

math::Vec3 read(const FloatArray& array, std::size_t i) {
  return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

void write(FloatArray& array, std::size_t i, math::Vec3 v) {
  array[3 * i] = v.x;
  array[3 * i + 1] = v.y;
  array[3 * i + 2] = v.z;
}

// Counts values that round to 0, and to 1 or -1.
struct NearZero {
  double zeros = 0, ones = 0;

  void add(float steps) {
    const float size = std::abs(steps);
    zeros += size < kRoundingDeadZone ? 1 : 0;
    ones += size >= kRoundingDeadZone && size < 1.5f ? 1 : 0;
  }
  // Returns the additional bits of a value of one step.
  double bits() const {
    return std::clamp(std::log2((zeros + 1.0) / (0.5 * ones + 1.0)), kMinBits, kMaxBits);
  }
};

void measure_bits(const Gaussians4D& set, std::span<const std::uint8_t> tier,
                  RoundingRules& rules) {
  NearZero luma[kMaxRoundingTiers][4], chroma[kMaxRoundingTiers][4];
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  for (std::size_t i = 0; i < set.size(); ++i) {
    for (std::size_t k = 1; k < coefficients; ++k) {
      const int band = math::sh_band_of(static_cast<int>(k));
      const float step = rules.tiers[tier[i]].sh[band];
      const math::Vec3 v = math::luma_chroma(read(set.sh, i * coefficients + k));
      luma[tier[i]][band].add(v.x / step);
      chroma[tier[i]][band].add(v.y / step);
      chroma[tier[i]][band].add(v.z / step);
    }
  }
  for (int t = 0; t < kMaxRoundingTiers; ++t) {
    RoundingSteps& steps = rules.tiers[t];
    for (int band = 1; band < 4 && steps.sh[band] > 0; ++band) {
      steps.luma_bits[band] = static_cast<float>(luma[t][band].bits() / steps.sh[band]);
      steps.chroma_bits[band] = static_cast<float>(chroma[t][band].bits() / steps.sh[band]);
    }
  }
}

}  // namespace

RoundingRules rounding_rules(const Quantisation& quantisation, double ticks, const Gaussians4D& set,
                             std::span<const std::uint8_t> tier) {
  RoundingRules rules;
  rules.opacity = size_of(quantisation.opacity);
  rules.part_ticks = static_cast<float>(ticks);
  for (std::size_t t = 0; t < quantisation.tiers.size(); ++t) {
    const TierSteps& from = quantisation.tiers[t];
    RoundingSteps& to = rules.tiers[t];
    to.position = size_of(from.position);
    to.displacement = size_of(from.displacement);
    to.log_scale = size_of(from.log_scale);
    to.rotation = size_of(from.rotation);
    for (std::size_t band = 0; band < 4; ++band) to.sh[band] = size_of(from.sh[band]);
  }
  measure_bits(set, tier, rules);
  return rules;
}

void round_primitive(const Gaussians4D& set, const RoundingRules& rules, int tier, std::size_t i,
                     Gaussians4D& out) {
  const RoundingSteps& steps = rules.tiers[tier];
  const math::Vec3 log_scale = math::rounded3(read(set.log_scale, i), steps.log_scale);
  write(out.position, i, math::rounded3(read(set.position, i), steps.position));
  write(out.log_scale, i, log_scale);
  const float* q = &set.rotation[4 * i];
  const math::Quat turned =
      math::rounded_rotation({q[0], q[1], q[2], q[3]}, steps.rotation, log_scale);
  float* to = &out.rotation[4 * i];
  to[0] = turned.w;
  to[1] = turned.x;
  to[2] = turned.y;
  to[3] = turned.z;
  out.opacity_logit[i] = math::rounded_to(set.opacity_logit[i], rules.opacity);
  const float scale = math::displacement_scale(set.sigma[i], set.radius[i], rules.part_ticks);
  write(out.velocity, i, math::rounded3(read(set.velocity, i), steps.displacement * scale));
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  for (std::size_t k = 0; k < coefficients; ++k) {
    write(out.sh, i * coefficients + k,
          math::rounded_colour(read(set.sh, i * coefficients + k),
                               steps.sh[math::sh_band_of(static_cast<int>(k))],
                               k == 0 ? 0.5f : kRoundingDeadZone));
  }
}

}  // namespace stgs::encoder
