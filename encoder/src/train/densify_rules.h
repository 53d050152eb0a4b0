// SPDX-License-Identifier: Apache-2.0
// Per-primitive decisions of densification, shared by the CPU and CUDA: free functions in the style
// of format/math.
#pragma once

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "train/random.h"
#include "train/vicinity.h"

namespace stgs::encoder {

inline constexpr float kSplitShrink = 1.6f;  // of the standard deviations of both halves (3DGS)
inline constexpr float kCloneSpread = 0.3f;  // offset of a clone, as a fraction of its size
// Random numbers consumed by a clone and by a split.
inline constexpr std::uint32_t kCloneDraws = 3 * Random::kNormalDraws;
inline constexpr std::uint32_t kSplitDraws = 2 * kCloneDraws;

// Thresholds in scene units.
struct DensifyRules {
  float prune_opacity, too_large;
  float split_limit;  // larger primitives split, smaller ones clone
  float clone_gradient, split_gradient;
  bool plain;  // growth as in 3DGS: mean gradients only, clones are exact copies
  Vicinity vicinity;
};

// Weights of the terms of the score s (paper eq. 5).
struct ScoreRules {
  double error, opacity, lifespan;
};

inline constexpr int kMaxEmptyViews = 48;

// The empty part of a view: the part of its frustum with a camera z below `depth`, widened by
// `margin` on each side. World to camera as in PinholeCamera; lengths in scene units.
struct EmptyView {
  math::Mat3 rotation;
  math::Vec3 translation;
  float tan_x, tan_y;  // half fields of view
  float depth, margin;
};

// Passed to kernels by value.
struct FreeSpace {
  EmptyView views[kMaxEmptyViews]{};
  int count = 0;
};

// Returns whether a position lies in free space.
STGS_FN bool in_free_space(const FreeSpace& space, math::Vec3 position) {
  for (int i = 0; i < space.count; ++i) {
    const EmptyView& view = space.views[i];
    const math::Vec3 p = math::mat3_mul(view.rotation, position);
    const float z = p.z + view.translation.z;
    if (!(z > 0.0f && z < view.depth)) continue;
    const float x = p.x + view.translation.x, y = p.y + view.translation.y;
    if (std::abs(x) < view.tan_x * z + view.margin && std::abs(y) < view.tan_y * z + view.margin)
      return true;
  }
  return false;
}

// Returns the largest standard deviation.
STGS_FN float max_scale(math::Vec3 log_scale) {
  return std::exp(math::larger(log_scale.x, math::larger(log_scale.y, log_scale.z)));
}

// Returns whether a primitive with finite values is neither too transparent nor too large.
STGS_FN bool survives(const DensifyRules& rules, float opacity_logit, math::Vec3 log_scale,
                      math::Vec3 position) {
  return !(math::opacity_of(opacity_logit) < rules.prune_opacity) &&
         max_scale(log_scale) < rules.too_large * size_factor(rules.vicinity, position);
}

// Returns the cap of an opacity reset: above the pruning threshold by the same factor as in 3DGS.
STGS_FN float reset_logit(const DensifyRules& rules) {
  const float cap = math::smaller(2.0f * rules.prune_opacity, 0.5f);
  return std::log(cap / (1.0f - cap));
}

STGS_FN bool is_split(const DensifyRules& rules, math::Vec3 log_scale) {
  return max_scale(log_scale) > rules.split_limit;
}

// Returns the mean gradient over its threshold; above 1, the primitive is cloned or split.
// views > 0.
STGS_FN float growth_urgency(const DensifyRules& rules, bool split, float gradient_sum,
                             float abs_gradient_sum, std::uint32_t views) {
  const bool absolute = split && !rules.plain;
  const float gradient = (absolute ? abs_gradient_sum : gradient_sum) / static_cast<float>(views);
  return gradient / (absolute ? rules.split_gradient : rules.clone_gradient);
}

// Returns the opacity of each of two coincident copies that together render as one:
// 1 - sqrt(1 - alpha).
STGS_FN float cloned_logit(float logit) {
  // With a = opacity: a' = 1 - sqrt(1-a), so a'/(1-a') = (1 - root)/root = a / (root (1 + root)).
  const float root = std::sqrt(1.0f - math::opacity_of(logit));
  return std::log(math::opacity_of(logit) / (math::larger(root, 1e-4f) * (1.0f + root)));
}

// Returns the score s (paper eq. 5). `unit` is the reciprocal of the error that counts as 1.
STGS_FN float densification_score(const ScoreRules& rules, float error, float unit,
                                  float opacity_logit, math::Vec3 v, float modulation) {
  const float speed = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
  const double scaled_error = math::smaller(1.0f, error * unit);
  const double opacity = math::opacity_of(opacity_logit);
  return static_cast<float>(rules.error * scaled_error + rules.opacity * opacity +
                            rules.lifespan * (1.0 - std::exp(-(speed + 1.0f) / modulation)));
}

// Draws a sample of the Gaussian scaled by `factor`, as an offset from its mean.
STGS_FN math::Vec3 gaussian_sample(math::Quat rotation, math::Vec3 log_scale, float factor,
                                   Random& random) {
  const float x = random.normal() * std::exp(log_scale.x) * factor;
  const float y = random.normal() * std::exp(log_scale.y) * factor;
  const float z = random.normal() * std::exp(log_scale.z) * factor;
  return math::mat3_mul(math::rotation_of(rotation), math::vec3_of(x, y, z));
}

}  // namespace stgs::encoder
