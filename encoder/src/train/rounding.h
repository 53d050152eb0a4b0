// SPDX-License-Identifier: Apache-2.0
// Training with quantisation in the loop: views render the values that a decoder will reconstruct,
// and the gradients change the learnt ones (straight-through).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/quantisation.h"

namespace stgs::encoder {

inline constexpr int kMaxRoundingTiers = 16;
// SH coefficients above degree 0 of fewer steps than this become 0: more than a half, because 0
// takes the fewest bits.
inline constexpr float kRoundingDeadZone = 0.6f;

// The steps of a tier in the units of the attributes, and the bits that SH coefficients of degree 1
// to 3 take per unit, luma and chroma, as a mean over the values near 0.
struct RoundingSteps {
  float position = 0, displacement = 0, log_scale = 0, rotation = 0;
  float sh[4] = {0, 0, 0, 0};
  float luma_bits[4] = {0, 0, 0, 0}, chroma_bits[4] = {0, 0, 0, 0};
};

// Plain memory, which a checkpoint stores and a GPU reads.
struct RoundingRules {
  RoundingSteps tiers[kMaxRoundingTiers];
  float opacity = 0;     // step of the logit
  float part_ticks = 0;  // length of the clip
};

// Returns the rules for a quantisation of at most kMaxRoundingTiers tiers, with the bits measured
// on a set. `tier`: of each primitive.
RoundingRules rounding_rules(const Quantisation& quantisation, double ticks, const Gaussians4D& set,
                             std::span<const std::uint8_t> tier);

// Rounds primitive i of a set. `out`, of the same size, receives everything but its lifespan.
void round_primitive(const Gaussians4D& set, const RoundingRules& rules, int tier, std::size_t i,
                     Gaussians4D& out);

}  // namespace stgs::encoder
