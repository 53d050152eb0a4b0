// SPDX-License-Identifier: Apache-2.0
#include "backend/cpu/adam_primitive.h"

#include <algorithm>

#include "stgs/format/math/lifespan.h"
#include "train/adam.h"

namespace stgs::encoder::cpu {

void adam_primitive(TrainState& state, std::size_t i, const LearntGradients& gradients,
                    const StepInput& input) {
  const float before = math::lifespan_modulation(state.set.sigma[i], state.set.radius[i]);
  const AdamCorrection correction(++state.updates[i], input.betas);
  const auto apply = [&](int attribute, std::size_t begin, std::size_t n, float rate) {
    const std::size_t at = i * static_cast<std::size_t>(state.components(attribute)) + begin;
    Moments& moments = state.moments[attribute];
    adam_step(state.values(attribute).data() + at, moments.first.data() + at,
              moments.second.data() + at, gradients.by[attribute] + begin, n, rate, correction,
              input.betas);
  };
  for (int a = 0; a < kAttributes; ++a) {
    if (a == kSh || (a == kRadius && !input.learn_radius)) continue;
    apply(a, 0, static_cast<std::size_t>(state.components(a)), input.rates[a]);
  }
  if (input.learn_radius) state.set.radius[i] = std::max(state.set.radius[i], 0.0f);
  const std::size_t sh = std::size_t{3} * gradients.coefficients;
  apply(kSh, 0, 3, input.rate_sh0);
  if (sh > 3) apply(kSh, 3, sh - 3, input.rates[kSh]);
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
