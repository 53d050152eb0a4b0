// SPDX-License-Identifier: Apache-2.0
#include "backend/cpu/adam_primitive.h"

#include <algorithm>
#include <array>

#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/quant.h"
#include "stgs/format/math/sh.h"
#include "train/adam.h"

namespace stgs::encoder::cpu {
namespace {

using ShGradient = std::array<float, std::size_t{3} * math::kShMaxCoefficients>;

// Returns the gradient of the SH coefficients with that of the rate added.
ShGradient with_rate(const TrainState& state, std::size_t i, const LearntGradients& gradients,
                     float weight) {
  const CompactionState& compaction = state.compaction;
  const RoundingSteps& steps = compaction.rules.tiers[compaction.tier[i]];
  ShGradient out{};
  std::copy_n(gradients.by[kSh], 3 * gradients.coefficients, out.begin());
  const float* sh = state.set.sh.data() + i * static_cast<std::size_t>(state.components(kSh));
  for (int k = 1; k < gradients.coefficients; ++k) {
    const int band = math::sh_band_of(k);
    const float* rgb = sh + 3 * k;
    const math::Vec3 by = math::colour_rate_grad({rgb[0], rgb[1], rgb[2]}, steps.luma_bits[band],
                                                 steps.chroma_bits[band]);
    float* to = out.data() + 3 * k;
    to[0] += weight * by.x;
    to[1] += weight * by.y;
    to[2] += weight * by.z;
  }
  return out;
}

}  // namespace

void adam_primitive(TrainState& state, std::size_t i, const LearntGradients& gradients,
                    const StepInput& input) {
  const float before = math::lifespan_modulation(state.set.sigma[i], state.set.radius[i]);
  const float factor =
      math::short_lived_factor(state.set.sigma[i], state.set.radius[i], input.short_lived);
  const AdamCorrection correction(++state.updates[i], input.betas);
  const auto apply = [&](int attribute, const float* gradient, std::size_t begin, std::size_t n,
                         float rate) {
    const std::size_t at = i * static_cast<std::size_t>(state.components(attribute)) + begin;
    Moments& moments = state.moments[attribute];
    adam_step(state.values(attribute).data() + at, moments.first.data() + at,
              moments.second.data() + at, gradient + begin, n, factor * rate, correction,
              input.betas);
  };
  for (int a = 0; a < kAttributes; ++a) {
    if (a == kSh || (a == kRadius && !input.learn_radius)) continue;
    apply(a, gradients.by[a], 0, static_cast<std::size_t>(state.components(a)), input.rates[a]);
  }
  if (input.learn_radius) state.set.radius[i] = std::max(state.set.radius[i], 0.0f);
  const std::size_t sh = std::size_t{3} * gradients.coefficients;
  apply(kSh, gradients.by[kSh], 0, 3, input.rate_sh0);
  if (sh > 3 && input.weight_rate > 0) {
    const ShGradient all = with_rate(state, i, gradients, input.weight_rate);
    apply(kSh, all.data(), 3, sh - 3, input.rates[kSh]);
  } else if (sh > 3) {
    apply(kSh, gradients.by[kSh], 3, sh - 3, input.rates[kSh]);
  }
  if (!state.is_coupled()) state.damp(i, before, input.modulated, input.damping);
  state.derive(i, input.modulated);
}

void gather_statistics(TrainState& state, std::size_t i, const ViewStatistics& view) {
  DensifyStatistics& statistics = state.statistics;
  statistics.gradient_sum[i] += view.gradient;
  statistics.abs_gradient_sum[i] += view.abs_gradient;
  statistics.error_max[i] = std::max(statistics.error_max[i], view.error);
  ++statistics.views[i];
}

}  // namespace stgs::encoder::cpu
