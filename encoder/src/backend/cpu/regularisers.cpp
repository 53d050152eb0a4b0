// SPDX-License-Identifier: Apache-2.0
#include "backend/cpu/regularisers.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

namespace stgs::encoder::cpu {
namespace {

// sqrt(-2 ln o_th): the factor of sigma in L_t, as in the paper.
const float kSpanFactor = std::sqrt(-2.0f * std::log(math::kAlphaThreshold));

float span_of(const Gaussians4D& set, std::size_t i) {
  return kSpanFactor * set.sigma[i] + set.radius[i];
}

float visibility_of(const Gaussians4D& set, std::size_t i, float ticks) {
  return math::visibility(ticks - set.time[i], set.sigma[i], set.radius[i]);
}

// Returns the index of the shortest axis.
int shortest_axis(const Gaussians4D& set, std::size_t i) {
  const float* s = &set.log_scale[3 * i];
  return static_cast<int>(std::min_element(s, s + 3) - s);
}

}  // namespace

double regularisation_loss(const Gaussians4D& set, std::span<const std::uint32_t> updates,
                           const SplatFrame& frame, const StepInput& input) {
  if (frame.splats.empty()) return 0.0;
  double lifespan = 0, opacity = 0, scale = 0;
  for (const Splat& splat : frame.splats) {
    const std::size_t i = splat.id;
    if (updates[i] == kFixed) continue;
    lifespan += 1.0 / span_of(set, i);
    opacity += math::opacity_of(set.opacity_logit[i]) * visibility_of(set, i, input.ticks);
    scale += std::exp(set.log_scale[3 * i + shortest_axis(set, i)]);
  }
  const double opacity_weight = input.second_stage ? input.weight_opacity : 0.0;
  const double sum =
      input.weight_lifespan * lifespan + opacity_weight * opacity + input.weight_scale * scale;
  return sum / static_cast<double>(frame.splats.size());
}

void regularise(const Gaussians4D& set, std::size_t visible, std::size_t i, const StepInput& input,
                float* d_log_scale, float& d_opacity_logit, float& d_sigma, float& d_radius) {
  const float weight = 1.0f / static_cast<float>(visible);
  const float span = span_of(set, i);
  const float d_span = -input.weight_lifespan * weight / (span * span);
  d_sigma += kSpanFactor * d_span;
  d_radius += d_span;
  if (input.second_stage) {
    const float opacity = math::opacity_of(set.opacity_logit[i]);
    // l(t) is held constant (the paper's stop-gradient).
    d_opacity_logit += input.weight_opacity * weight * visibility_of(set, i, input.ticks) *
                       opacity * (1.0f - opacity);
  }
  const int axis = shortest_axis(set, i);
  d_log_scale[axis] += input.weight_scale * weight * std::exp(set.log_scale[3 * i + axis]);
}

}  // namespace stgs::encoder::cpu
