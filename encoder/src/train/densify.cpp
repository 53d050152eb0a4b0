// SPDX-License-Identifier: Apache-2.0
#include "train/densify.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stgs::encoder {
namespace {

math::Vec3 log_scale_of(const TrainState& state, std::size_t i) {
  const float* s = &state.set.log_scale[3 * i];
  return {s[0], s[1], s[2]};
}

math::Vec3 position_of(const TrainState& state, std::size_t i) {
  const float* p = &state.set.position[3 * i];
  return {p[0], p[1], p[2]};
}

// Makes `to` a clone of `from`. Both get the opacity that preserves the render; the clone is
// offset.
void clone_into(TrainState& state, std::size_t from, std::size_t to, Random& random) {
  state.set.opacity_logit[from] = cloned_logit(state.set.opacity_logit[from]);
  state.clear_moments(from);
  state.copy_parameters(from, to);
  move_by_sample(state, to, kCloneSpread, random);
}

void split_into(TrainState& state, std::size_t from, std::size_t to, Random& random) {
  state.clear_moments(from);
  state.copy_parameters(from, to);
  move_by_sample(state, to, 1.0f, random);
  move_by_sample(state, from, 1.0f, random);
  FloatArray& log_scale = state.values(kLogScale);
  for (int c = 0; c < 3; ++c) {
    log_scale[3 * from + c] -= std::log(kSplitShrink);
    log_scale[3 * to + c] = log_scale[3 * from + c];
  }
}

struct Candidate {
  std::uint32_t index;
  float urgency;  // gradient over its threshold
  bool split;
};

std::vector<Candidate> growth_candidates(const TrainState& state, const DensifyRules& rules) {
  std::vector<Candidate> candidates;
  const DensifyStatistics& statistics = state.statistics;
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (statistics.views[i] == 0 || state.is_fixed(i)) continue;
    const bool split = is_split(rules, log_scale_of(state, i));
    const float urgency = growth_urgency(rules, split, statistics.gradient_sum[i],
                                         statistics.abs_gradient_sum[i], statistics.views[i]);
    if (urgency > 1.0f) candidates.push_back({static_cast<std::uint32_t>(i), urgency, split});
  }
  return candidates;
}

// Reduces the candidates to the `count` limit urgent, in index order.
void retain_most_urgent(std::vector<Candidate>& candidates, std::size_t count) {
  const auto by_urgency = [](const Candidate& a, const Candidate& b) {
    return a.urgency != b.urgency ? a.urgency > b.urgency : a.index < b.index;
  };
  if (candidates.size() > count) {
    std::nth_element(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(count),
                     candidates.end(), by_urgency);
    candidates.resize(count);
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.index < b.index; });
}

bool is_finite(const TrainState& state, std::size_t i) {
  for (int a = 0; a < kAttributes; ++a) {
    const std::size_t n = state.components(a);
    const float* values = state.values(a).data() + i * n;
    for (std::size_t c = 0; c < n; ++c) {
      if (!std::isfinite(values[c])) return false;
    }
  }
  return std::isfinite(state.set.sigma[i]) && state.set.sigma[i] > 0.0f;
}

}  // namespace

void move_by_sample(TrainState& state, std::size_t i, float factor, Random& random) {
  const float* q = &state.set.rotation[4 * i];
  const math::Vec3 offset =
      gaussian_sample({q[0], q[1], q[2], q[3]}, log_scale_of(state, i), factor, random);
  state.set.position[3 * i] += offset.x;
  state.set.position[3 * i + 1] += offset.y;
  state.set.position[3 * i + 2] += offset.z;
}

std::vector<std::uint32_t> list_survivors(const TrainState& state, const DensifyRules& rules,
                                          const FreeSpace& free_space, std::size_t& non_finite) {
  std::vector<std::uint32_t> survivors;
  survivors.reserve(state.size());
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (state.is_fixed(i)) {
      survivors.push_back(static_cast<std::uint32_t>(i));
    } else if (!is_finite(state, i)) {
      ++non_finite;
    } else if (survives(rules, state.set.opacity_logit[i], log_scale_of(state, i),
                        position_of(state, i)) &&
               !in_free_space(free_space, position_of(state, i))) {
      survivors.push_back(static_cast<std::uint32_t>(i));
    }
  }
  return survivors;
}

DensifyRules densify_rules(const HyperParameters& parameters, const DensifyContext& context) {
  return {static_cast<float>(context.plain ? parameters.plain_prune : parameters.prune_opacity),
          static_cast<float>(parameters.prune_scale) * context.extent,
          static_cast<float>(parameters.split_scale) * context.extent,
          static_cast<float>(parameters.clone_gradient),
          static_cast<float>(parameters.split_gradient),
          context.plain,
          context.vicinity};
}

std::size_t max_trained(const HyperParameters& parameters, std::size_t fixed) {
  const auto limit = static_cast<std::size_t>(std::max(parameters.max_primitives, 0));
  return limit - std::min(fixed, limit / 2);
}

std::size_t max_growth(const HyperParameters& parameters, const DensifyContext& context,
                       std::size_t present, std::size_t fixed) {
  const std::size_t limit = max_trained(parameters, fixed), counted = present - fixed;
  const std::size_t capacity = limit > counted ? limit - counted : 0;
  if (context.plain) return capacity;
  return std::min(capacity, static_cast<std::size_t>(parameters.growth_limit *
                                                     static_cast<double>(present - fixed)));
}

std::size_t max_replacements(const HyperParameters& parameters, std::size_t surviving,
                             std::size_t dead) {
  const auto limit =
      static_cast<std::size_t>(parameters.replace_limit * static_cast<double>(surviving + dead));
  return std::min({dead, surviving, limit});
}

std::size_t remove_non_finite(TrainState& state) {
  std::vector<std::uint32_t> survivors;
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (is_finite(state, i)) survivors.push_back(static_cast<std::uint32_t>(i));
  }
  const std::size_t non_finite = state.size() - survivors.size();
  if (non_finite > 0) state.retain(survivors);
  return non_finite;
}

void reset_opacity(TrainState& state, const DensifyRules& rules) {
  const float cap = reset_logit(rules);
  for (std::size_t i = 0; i < state.size(); ++i) {
    float& logit = state.set.opacity_logit[i];
    if (logit <= cap || state.is_fixed(i)) continue;
    logit = cap;
    state.moments[kOpacity].first[i] = 0.0f;
    state.moments[kOpacity].second[i] = 0.0f;
  }
}

DensifyCounts grow(TrainState& state, const HyperParameters& parameters,
                   const DensifyContext& context) {
  DensifyCounts counts;
  const std::size_t before = state.size();
  const DensifyRules rules = densify_rules(parameters, context);
  const std::vector<std::uint32_t> survivors =
      list_survivors(state, rules, context.free_space, counts.non_finite);
  counts.removed = before - survivors.size();
  if (counts.removed > 0) state.retain(survivors);

  std::vector<Candidate> candidates = growth_candidates(state, rules);
  const std::size_t present = state.size();
  retain_most_urgent(candidates, max_growth(parameters, context, present, state.count_fixed()));
  state.resize(present + candidates.size());
  Random random(context.seed, state.iteration, RandomPurpose::kDensify);
  for (std::size_t k = 0; k < candidates.size(); ++k) {
    if (candidates[k].split) {
      split_into(state, candidates[k].index, present + k, random);
      ++counts.split;
    } else {
      if (context.plain) {
        // The copy coincides with its original, whose Adam moments remain; that separates them
        // (3DGS).
        state.copy_parameters(candidates[k].index, present + k);
      } else {
        clone_into(state, candidates[k].index, present + k, random);
      }
      ++counts.cloned;
    }
  }
  state.statistics.reset(state.size());
  return counts;
}

std::vector<float> densification_scores(const TrainState& state, const HyperParameters& parameters,
                                        bool modulated) {
  const std::size_t n = state.size();
  std::vector<float> scores(n);
  std::vector<float> errors = state.statistics.error_max;
  const std::size_t rank = unit_error_rank(n, state.count_fixed());
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(rank),
                   errors.end());
  const float unit = errors[rank] > 0.0f ? 1.0f / errors[rank] : 0.0f;
  const ScoreRules rules{parameters.score_error, parameters.score_opacity,
                         parameters.score_lifespan};
  for (std::size_t i = 0; i < n; ++i) {
    const float* v = &state.velocity[3 * i];
    const float f =
        modulated ? math::lifespan_modulation(state.set.sigma[i], state.set.radius[i]) : 1.0f;
    scores[i] = densification_score(rules, state.statistics.error_max[i], unit,
                                    state.set.opacity_logit[i], {v[0], v[1], v[2]}, f);
  }
  return scores;
}

DensifyCounts replace(TrainState& state, const HyperParameters& parameters,
                      const DensifyContext& context) {
  DensifyCounts counts;
  if (state.size() == 0) return counts;
  const DensifyRules rules = densify_rules(parameters, context);
  const std::vector<std::uint32_t> survivors =
      list_survivors(state, rules, context.free_space, counts.non_finite);
  std::vector<bool> survives_pruning(state.size(), false);
  for (std::uint32_t i : survivors) survives_pruning[i] = true;
  std::vector<std::uint32_t> dead;
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (!survives_pruning[i]) dead.push_back(static_cast<std::uint32_t>(i));
  }
  std::vector<std::uint32_t> best = survivors;
  std::erase_if(best, [&state](std::uint32_t i) { return state.is_fixed(i); });
  const std::size_t count = max_replacements(parameters, best.size(), dead.size());
  const std::vector<float> scores = densification_scores(state, parameters, context.modulated);
  const auto by_score = [&scores](std::uint32_t a, std::uint32_t b) {
    return scores[a] != scores[b] ? scores[a] > scores[b] : a < b;
  };
  std::partial_sort(best.begin(), best.begin() + static_cast<std::ptrdiff_t>(count), best.end(),
                    by_score);
  Random random(context.seed, state.iteration, RandomPurpose::kDensify);
  for (std::size_t k = 0; k < count; ++k) clone_into(state, best[k], dead[k], random);
  counts.replaced = count;
  state.statistics.reset(state.size());
  return counts;
}

}  // namespace stgs::encoder
