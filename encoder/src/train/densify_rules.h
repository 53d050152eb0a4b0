// SPDX-License-Identifier: Apache-2.0
// What densification decides for one primitive, once for the CPU and for CUDA: free functions in
// the style of format/math.
#pragma once

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "train/random.h"

namespace stgs::encoder {

inline constexpr float kSplitShrink = 1.6f;  // of the standard deviations of both halves (3DGS)
inline constexpr float kCloneSpread = 0.3f;  // share of the own size that a clone is moved by
// Random numbers that a clone and a split take.
inline constexpr std::uint32_t kCloneDraws = 3 * Random::kNormalDraws;
inline constexpr std::uint32_t kSplitDraws = 2 * kCloneDraws;

// Thresholds in scene units.
struct DensifyRules {
  float prune_opacity, too_large;
  float split_limit;  // larger ones split, smaller ones clone
  float clone_gradient, split_gradient;
  bool plain;  // growth as in 3DGS: mean gradients alone, clones that are copies
};

// The factors of the score s (paper eq. 5).
struct ScoreRules {
  double error, opacity, lifespan;
};

STGS_FN float largest_scale(math::Vec3 log_scale) {
  return std::exp(math::larger(log_scale.x, math::larger(log_scale.y, log_scale.z)));
}

// Whether a primitive whose values are all numbers is worth keeping.
STGS_FN bool survives(const DensifyRules& rules, float opacity_logit, math::Vec3 log_scale) {
  return !(math::opacity_of(opacity_logit) < rules.prune_opacity) &&
         largest_scale(log_scale) < rules.too_large;
}

// What a reset caps opacities at: above what is pruned by as much as in 3DGS.
STGS_FN float reset_logit(const DensifyRules& rules) {
  const float cap = math::smaller(2.0f * rules.prune_opacity, 0.5f);
  return std::log(cap / (1.0f - cap));
}

STGS_FN bool is_split(const DensifyRules& rules, math::Vec3 log_scale) {
  return largest_scale(log_scale) > rules.split_limit;
}

// Mean gradient over its threshold; above 1, the primitive is cloned or split. views > 0.
STGS_FN float growth_urgency(const DensifyRules& rules, bool split, float gradient_sum,
                             float abs_gradient_sum, std::uint32_t views) {
  const bool absolute = split && !rules.plain;
  const float gradient = (absolute ? abs_gradient_sum : gradient_sum) / static_cast<float>(views);
  return gradient / (absolute ? rules.split_gradient : rules.clone_gradient);
}

// Opacity of each of two coinciding copies that together look like one: 1 - sqrt(1 - alpha).
STGS_FN float cloned_logit(float logit) {
  // With a = opacity: a' = 1 - sqrt(1-a), so a'/(1-a') = (1 - root)/root = a / (root (1 + root)).
  const float root = std::sqrt(1.0f - math::opacity_of(logit));
  return std::log(math::opacity_of(logit) / (math::larger(root, 1e-4f) * (1.0f + root)));
}

// The score; `unit` is 1 over the error that counts as 1.
STGS_FN float densification_score(const ScoreRules& rules, float error, float unit,
                                  float opacity_logit, math::Vec3 v, float modulation) {
  const float speed = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
  const double share = math::smaller(1.0f, error * unit);
  const double opacity = math::opacity_of(opacity_logit);
  return static_cast<float>(rules.error * share + rules.opacity * opacity +
                            rules.lifespan * (1.0 - std::exp(-(speed + 1.0f) / modulation)));
}

// A sample of the Gaussian times `share`, as an offset from its mean.
STGS_FN math::Vec3 gaussian_sample(math::Quat rotation, math::Vec3 log_scale, float share,
                                   Random& random) {
  const float x = random.normal() * std::exp(log_scale.x) * share;
  const float y = random.normal() * std::exp(log_scale.y) * share;
  const float z = random.normal() * std::exp(log_scale.z) * share;
  return math::mat3_mul(math::rotation_of(rotation), math::vec3_of(x, y, z));
}

}  // namespace stgs::encoder
