// SPDX-License-Identifier: Apache-2.0
#include "train/relocation.h"

#include <algorithm>
#include <cmath>

namespace stgs::encoder {
namespace {

constexpr int kMaxCopies = 51;                // whose opacity is computed (3DGS-MCMC)
constexpr double kMaxRelocated = 1.0 - 1e-6;  // opacity of a source
constexpr double kMargin = 1.01;              // above the smallest opacity, for rounding

// Returns the running sums of the unnormalised probabilities.
std::vector<double> cumulative_probabilities(std::span<const float> opacity_logit,
                                             std::span<const float> gradient_sum,
                                             std::span<const std::uint32_t> views,
                                             std::span<const std::uint32_t> survives) {
  const std::size_t n = survives.size();
  const auto opacity = [&](std::size_t i) -> double {
    return survives[i] == 1 ? math::opacity_of(opacity_logit[i]) : 0.0;
  };
  const auto gradient = [&](std::size_t i) -> double {
    const bool known = survives[i] == 1 && views[i] > 0 && std::isfinite(gradient_sum[i]);
    return known ? gradient_sum[i] / static_cast<float>(views[i]) : 0.0;
  };
  double opacities = 0, gradients = 0;
  for (std::size_t i = 0; i < n; ++i) {
    opacities += opacity(i);
    gradients += gradient(i);
  }
  std::vector<double> sums(n);
  double sum = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (opacities > 0) sum += opacity(i) / opacities;
    if (gradients > 0) sum += gradient(i) / gradients;
    sums[i] = sum;
  }
  return sums;
}

}  // namespace

// With O' = 1 - (1 - O)^(1/n), the scales shrink by
//   O / sum_{i=1..n} sum_{k=0..i-1} (-1)^k binomial(i-1, k) O'^(k+1) / sqrt(k+1).
RelocatedValues relocated_values(double o, int n) {
  const double each = 1.0 - std::pow(1.0 - o, 1.0 / n);
  double sum = 0;
  for (int i = 1; i <= n; ++i) {
    double term = each;  // (-1)^k binomial(i-1, k) O'^(k+1)
    for (int k = 0; k < i; ++k) {
      sum += term / std::sqrt(k + 1.0);
      term *= -each * (i - 1 - k) / (k + 1);
    }
  }
  return {each, o / sum};
}

Relocation plan_relocation(std::span<const float> opacity_logit,
                           std::span<const float> gradient_sum,
                           std::span<const std::uint32_t> views,
                           std::span<const std::uint32_t> survives, float min_opacity,
                           Random random) {
  Relocation plan;
  const double least = kMargin * min_opacity;
  const std::vector<double> sums =
      cumulative_probabilities(opacity_logit, gradient_sum, views, survives);
  if (sums.empty() || !(sums.back() > 0)) return plan;
  for (std::size_t i = 0; i < survives.size(); ++i) {
    if (survives[i]) continue;
    const double at = static_cast<double>(random.uniform()) * sums.back();
    const auto source = std::upper_bound(sums.begin(), sums.end(), at);
    plan.from.push_back(
        static_cast<std::uint32_t>(std::min(source, sums.end() - 1) - sums.begin()));
    plan.to.push_back(static_cast<std::uint32_t>(i));
  }
  std::vector<std::uint32_t> sorted = plan.from;
  std::sort(sorted.begin(), sorted.end());
  for (std::size_t first = 0, end; first < sorted.size(); first = end) {
    end = first;
    while (end < sorted.size() && sorted[end] == sorted[first]) ++end;
    const int copies = static_cast<int>(std::min<std::size_t>(end - first + 1, kMaxCopies));
    const double opacity = std::clamp(
        static_cast<double>(math::opacity_of(opacity_logit[sorted[first]])), least, kMaxRelocated);
    const RelocatedValues values = relocated_values(opacity, copies);
    const double each = std::max(values.opacity, least);
    plan.sources.push_back(sorted[first]);
    plan.logits.push_back(static_cast<float>(std::log(each / (1.0 - each))));
    plan.log_shrinks.push_back(static_cast<float>(std::log(values.scale)));
  }
  return plan;
}

DensifyCounts relocate(TrainState& state, const HyperParameters& parameters,
                       const DensifyContext& context) {
  DensifyCounts counts;
  const DensifyRules rules = densify_rules(parameters, context);
  std::vector<std::uint32_t> survives(state.size(), 0);
  for (std::uint32_t i : list_survivors(state, rules, context.free_space, counts.non_finite))
    survives[i] = state.is_fixed(i) ? kFixedSurvivor : 1;
  const Relocation plan = plan_relocation(
      state.set.opacity_logit, state.statistics.gradient_sum, state.statistics.views, survives,
      rules.prune_opacity, Random(context.seed, state.iteration, RandomPurpose::kRelocation));
  FloatArray& log_scale = state.values(kLogScale);
  for (std::size_t k = 0; k < plan.sources.size(); ++k) {
    const std::uint32_t i = plan.sources[k];
    state.set.opacity_logit[i] = plan.logits[k];
    for (int c = 0; c < 3; ++c) log_scale[3 * i + c] += plan.log_shrinks[k];
    state.clear_moments(i);
  }
  Random random(context.seed, state.iteration, RandomPurpose::kDensify);
  for (std::size_t k = 0; k < plan.to.size(); ++k) {
    state.copy_parameters(plan.from[k], plan.to[k]);
    move_by_sample(state, plan.to[k], kCloneSpread, random);
  }
  counts.replaced = plan.to.size();
  state.statistics.reset(state.size());
  return counts;
}

}  // namespace stgs::encoder
