// SPDX-License-Identifier: Apache-2.0
// Densification: clones, splits, removals and replacements, and their schedule.
#include "train/densify.h"

#include <cmath>
#include <tuple>

#include "catch.h"
#include "random_train_state.h"
#include "stgs/format/math/blend.h"
#include "train/densify_plan.h"
#include "train/densify_rules.h"
#include "train/relocation.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

TEST_CASE("two clones transmit as much light as their original") {
  for (const float logit : {-4.0f, -1.0f, 0.0f, 2.0f, 6.0f}) {
    const float clone = math::opacity_of(cloned_logit(logit));
    CHECK((1 - clone) * (1 - clone) == Approx(1 - math::opacity_of(logit)).epsilon(1e-3));
  }
}

TEST_CASE("growth clones small primitives, splits large ones and removes transparent ones") {
  TrainState state = random_train_state(8, 5);
  HyperParameters parameters;
  parameters.max_primitives = 100;
  parameters.growth_limit = 1.0;
  DensifyContext context;
  context.extent = 1.0f;
  const float small = std::log(0.001f), large = std::log(0.1f);
  for (std::size_t i = 0; i < 8; ++i) {
    state.set.opacity_logit[i] = 0.0f;
    std::fill_n(state.set.log_scale.begin() + 3 * static_cast<int>(i), 3, i < 4 ? small : large);
    state.statistics.views[i] = 1;
  }
  state.set.opacity_logit[7] = -8.0f;
  state.statistics.gradient_sum[1] = 1.0f;      // small with a large gradient: clone
  state.statistics.gradient_sum[5] = 1.0f;      // large: only the absolute gradient counts
  state.statistics.abs_gradient_sum[6] = 1.0f;  // large with a large absolute gradient: split
  const DensifyCounts counts = grow(state, parameters, context);
  CHECK(counts.cloned == 1);
  CHECK(counts.split == 1);
  CHECK(counts.removed == 1);
  REQUIRE(state.size() == 9);
  CHECK(math::opacity_of(state.set.opacity_logit[1]) == Approx(1 - std::sqrt(0.5f)));
  CHECK(state.set.log_scale[3 * 6] == Approx(large - std::log(1.6f)));
  CHECK(state.statistics.views[1] == 0);
}

TEST_CASE("the largest size grows with the distance beyond the vicinity") {
  const HyperParameters parameters;
  DensifyContext context;
  context.extent = 1.0f;
  context.vicinity = {{1, 0, 0}, 4};
  const DensifyRules rules = densify_rules(parameters, context);
  const auto survives_at = [&](float x, double size) {
    const auto s = static_cast<float>(std::log(size * parameters.prune_scale));
    return survives(rules, 0.0f, {-9, s, -9}, {x, 0, 0});
  };
  for (const float x : {-2.9f, 1.0f, 4.9f}) {
    CHECK(survives_at(x, 0.99));
    CHECK_FALSE(survives_at(x, 1.01));
  }
  CHECK(survives_at(401, 99));
  CHECK(survives_at(-399, 99));
  CHECK_FALSE(survives_at(401, 101));
  context.vicinity = {};
  CHECK_FALSE(survives(densify_rules(parameters, context), 0.0f, {-9, 1, -9}, {401, 0, 0}));
}

TEST_CASE("plain growth uses the mean gradient alone, and its clones are exact copies") {
  TrainState state = random_train_state(4, 5);
  for (float& logit : state.set.opacity_logit) logit = 0.0f;
  for (int c = 0; c < 3; ++c) {
    state.set.log_scale[c] = std::log(1e-4f);  // primitives 0 and 3 are small
    state.set.log_scale[3 + c] = state.set.log_scale[6 + c] = std::log(0.05f);
    state.set.log_scale[9 + c] = std::log(1e-4f);
  }
  state.statistics.views = {10, 10, 10, 10};
  const HyperParameters parameters;
  const auto large_gradient = static_cast<float>(2 * parameters.clone_gradient * 10);
  state.statistics.gradient_sum = {large_gradient, large_gradient, 0.0f, 0.0f};
  state.statistics.abs_gradient_sum = {large_gradient, large_gradient, 100.0f, 100.0f};
  state.moments[kOpacity].first[0] = 0.5f;
  DensifyContext context;
  context.plain = true;
  const DensifyCounts counts = grow(state, parameters, context);
  CHECK(counts.cloned == 1);
  CHECK(counts.split == 1);  // primitive 2 has only a large absolute gradient
  REQUIRE(state.size() == 6);
  for (int c = 0; c < 3; ++c) CHECK(state.set.position[12 + c] == state.set.position[c]);
  CHECK(state.set.opacity_logit[0] == 0.0f);
  CHECK(state.set.opacity_logit[4] == 0.0f);
  CHECK(state.moments[kOpacity].first[0] == 0.5f);
  CHECK(state.moments[kOpacity].first[4] == 0.0f);
}

TEST_CASE("the plan follows the paper, or 3DGS under plain densification") {
  HyperParameters p;
  p.opacity_resets = 2;
  const Ablation full;
  Ablation plain;
  plain.densification = Densification::kPlain;
  const auto plan_at = [&](const Ablation& ablation, double progress) {
    return densify_plan(p, ablation, progress, true);
  };
  CHECK_FALSE(plan_at(full, 0.02).grow);
  CHECK(plan_at(full, 0.2).grow);
  CHECK(plan_at(full, 0.2).resets_due == 1);
  CHECK(plan_at(full, 0.34).second_stage);
  CHECK(plan_at(full, 0.34).replace);
  CHECK_FALSE(plan_at(full, 0.34).grow);
  CHECK_FALSE(plan_at(full, 0.9).replace);
  CHECK_FALSE(plan_at(full, 0.9).gather);
  CHECK_FALSE(densify_plan(p, full, 0.2, false).grow);
  CHECK(densify_plan(p, full, 0.2, false).gather);
  CHECK(plan_at(plain, 0.45).grow);
  CHECK(plan_at(plain, 0.45).resets_due == 4);
  for (const double progress : {0.34, 0.5, 0.7, 0.99}) {
    CHECK_FALSE(plan_at(plain, progress).replace);
    CHECK(plan_at(plain, progress).second_stage);  // the second stage of the losses is unaffected
    CHECK(plan_at(plain, progress).grow == (progress < 0.5));
  }
  CHECK_FALSE(plan_at(plain, 0.5).gather);
}

TEST_CASE("FreeTimeGS relocates until densify_until, with L_opacity from the start") {
  const HyperParameters p;
  Ablation parts;
  parts.densification = Densification::kRelocation;
  const DensifyPlan before = densify_plan(p, parts, 0.02, true);
  CHECK_FALSE(before.relocate);
  CHECK(before.second_stage);
  for (const double progress : {0.1, 0.5, 0.84}) {
    const DensifyPlan plan = densify_plan(p, parts, progress, true);
    CHECK(plan.relocate);
    CHECK_FALSE(plan.grow);
    CHECK_FALSE(plan.replace);
    CHECK_FALSE(densify_plan(p, parts, progress, false).relocate);
  }
  CHECK_FALSE(densify_plan(p, parts, 0.86, true).relocate);
}

TEST_CASE("relocated copies render as their source") {
  for (const double opacity : {0.05, 0.5, 0.99}) {
    const RelocatedValues same = relocated_values(opacity, 1);
    CHECK(same.opacity == Approx(opacity));
    CHECK(same.scale == Approx(1.0));
    for (const int n : {2, 5, 51}) {
      const RelocatedValues values = relocated_values(opacity, n);
      CHECK(1.0 - std::pow(1.0 - values.opacity, n) == Approx(opacity));
      // The integral along a line through the centre is that of the source (3DGS-MCMC, eq. 9).
      double source = 0, copies = 0;
      for (double x = -6; x <= 6; x += 1e-3) {
        source += 1e-3 * opacity * std::exp(-0.5 * x * x);
        const double y = x / values.scale;
        copies += 1e-3 * (1.0 - std::pow(1.0 - values.opacity * std::exp(-0.5 * y * y), n));
      }
      CHECK(copies == Approx(source).epsilon(0.01));
    }
  }
}

TEST_CASE("faint primitives are relocated to opaque ones with large gradients") {
  TrainState state = random_train_state(3000, 7);
  HyperParameters parameters;
  parameters.prune_scale = 1e6;
  for (std::size_t i = 0; i < state.size(); ++i) {
    // Faint, opaque, and opaque with a gradient, in turn.
    state.set.opacity_logit[i] = i % 3 == 0 ? -8.0f : 0.0f;
    state.statistics.views[i] = 2;
    state.statistics.gradient_sum[i] = i % 3 == 2 ? 1e-3f : 0.0f;
    state.updates[i] = 3;
    state.moments[kOpacity].first[i] = 1.0f;
  }
  const FloatArray before = state.set.position;
  const DensifyCounts counts = relocate(state, parameters, {});
  CHECK(counts.replaced == 1000);
  REQUIRE(state.size() == 3000);
  int from_gradient = 0;
  for (std::size_t i = 0; i < state.size(); i += 3) {
    // The nearest of the others is the source, except where the samples of a Gaussian meet.
    std::size_t nearest = 1;
    double least = 1e30;
    for (std::size_t j = 1; j < state.size(); ++j) {
      if (j % 3 == 0) continue;
      double square = 0;
      for (int c = 0; c < 3; ++c)
        square += std::pow(state.set.position[3 * i + c] - before[3 * j + c], 2);
      if (square < least) std::tie(least, nearest) = std::tuple(square, j);
    }
    from_gradient += nearest % 3 == 2 ? 1 : 0;
    CHECK(state.updates[i] == 0);
    CHECK(state.moments[kOpacity].first[i] == 0.0f);
  }
  // Sources share their opacity with their copies, and no primitive is relocated again at once.
  int changed = 0;
  for (std::size_t i = 0; i < state.size(); ++i) {
    const float opacity = math::opacity_of(state.set.opacity_logit[i]);
    CHECK(opacity >= parameters.prune_opacity);
    const bool copied = opacity < 0.499f;
    CHECK(copied == (state.updates[i] == 0));
    changed += copied && i % 3 != 0 ? 1 : 0;
  }
  CHECK(changed > 400);
  // Half of the probability is that of the opacities: 3/4 of the sources have gradients.
  CHECK(from_gradient > 600);
  CHECK(from_gradient < 850);
  for (std::uint32_t views : state.statistics.views) CHECK(views == 0);
  // Nothing to copy from.
  std::fill(state.set.opacity_logit.begin(), state.set.opacity_logit.end(), -8.0f);
  CHECK(relocate(state, parameters, {}).replaced == 0);
}

TEST_CASE("a non-finite primitive is replaced or removed") {
  HyperParameters parameters;
  parameters.replace_limit = 1.0;
  TrainState state = random_train_state(20, 11);
  std::fill(state.set.opacity_logit.begin(), state.set.opacity_logit.end(), 0.0f);
  TrainState refined = state;
  refined.set.position[3 * 4 + 1] = std::nanf("");
  CHECK(replace(refined, parameters, {}).non_finite == 1);
  CHECK(std::isfinite(refined.set.position[3 * 4 + 1]));
  state.velocity[3 * 7] = INFINITY;
  CHECK(grow(state, parameters, {}).non_finite == 1);
  CHECK(state.size() == 19);
  state.log_sigma[2] = std::nanf("");
  CHECK(remove_non_finite(state) == 1);
  CHECK(state.size() == 18);
}

TEST_CASE("growth stops at the limit and grows the primitives of the highest gradients") {
  TrainState state = random_train_state(10, 6);
  HyperParameters parameters;
  parameters.max_primitives = 12;
  parameters.growth_limit = 1.0;
  for (std::size_t i = 0; i < 10; ++i) {
    state.set.opacity_logit[i] = 0.0f;
    std::fill_n(state.set.log_scale.begin() + 3 * static_cast<int>(i), 3, std::log(1e-4f));
    state.statistics.views[i] = 1;
    state.statistics.gradient_sum[i] = 1.0f + static_cast<float>(i);
  }
  grow(state, parameters, {});
  REQUIRE(state.size() == 12);
  CHECK(math::opacity_of(state.set.opacity_logit[9]) < 0.4f);
  CHECK(math::opacity_of(state.set.opacity_logit[8]) < 0.4f);
  CHECK(math::opacity_of(state.set.opacity_logit[0]) == Approx(0.5f));
}

TEST_CASE("replacement keeps the number of primitives and clones the highest scores") {
  TrainState state = random_train_state(50, 7);
  HyperParameters parameters;
  parameters.replace_limit = 1.0;
  for (std::size_t i = 0; i < 50; ++i) state.set.opacity_logit[i] = 0.0f;
  state.set.opacity_logit[3] = state.set.opacity_logit[4] = -9.0f;
  state.statistics.error_max[20] = 10.0f;
  state.statistics.error_max[30] = 10.0f;
  for (std::size_t i : {20, 30}) state.log_sigma[i] = std::log(0.5f);
  state.derive_all(true);
  const DensifyCounts counts = replace(state, parameters, {});
  CHECK(state.size() == 50);
  CHECK(counts.replaced == 2);
  CHECK(state.log_sigma[3] == Approx(std::log(0.5f)));
  CHECK(math::opacity_of(state.set.opacity_logit[20]) == Approx(1 - std::sqrt(0.5f)));
}

TEST_CASE("densification leaves fixed primitives as they are") {
  for (const int kind : {0, 1, 2}) {
    TrainState state = random_train_state(60, 7);
    HyperParameters parameters;
    parameters.max_primitives = 1000;
    parameters.growth_limit = parameters.replace_limit = 1.0;
    for (std::size_t i = 0; i < state.size(); ++i) {
      state.set.opacity_logit[i] = i % 4 < 2 ? -9.0f : 0.0f;  // a removal, if it is not fixed
      state.statistics.views[i] = 1;
      state.statistics.gradient_sum[i] = state.statistics.abs_gradient_sum[i] = 1.0f;
      state.statistics.error_max[i] = i % 2 == 0 ? 0.0f : 1.0f;
      state.updates[i] = i % 2 == 0 ? kFixed : 5;
    }
    const Gaussians4D before = state.set;
    const DensifyCounts counts = kind == 0   ? grow(state, parameters, {})
                                 : kind == 1 ? replace(state, parameters, {})
                                             : relocate(state, parameters, {});
    if (kind == 0) reset_opacity(state, densify_rules(parameters, {}));
    INFO(kind);
    CHECK(state.count_fixed() == 30);
    CHECK(counts.removed == (kind == 0 ? 15 : 0));
    CHECK(counts.replaced == (kind == 0 ? 0 : 15));
    std::size_t found = 0;
    for (std::size_t i = 0; i < state.size(); ++i) {
      if (!state.is_fixed(i)) continue;
      // Their order stays.
      CHECK(state.set.opacity_logit[i] == before.opacity_logit[2 * found]);
      CHECK(state.set.position[3 * i] == before.position[3 * 2 * found]);
      CHECK(state.set.log_scale[3 * i] == before.log_scale[3 * 2 * found]);
      ++found;
    }
  }
}

TEST_CASE("the score prefers short-lived, fast primitives at equal error and opacity") {
  TrainState state = random_train_state(3, 8);
  std::fill(state.set.opacity_logit.begin(), state.set.opacity_logit.end(), 0.0f);
  std::fill(state.set.radius.begin(), state.set.radius.end(), 0.0f);
  std::fill(state.velocity.begin(), state.velocity.end(), 0.0f);
  state.log_sigma = {std::log(0.8f), std::log(0.8f), std::log(60.0f)};
  state.velocity[0] = 3.0f;
  state.derive_all(true);
  const std::vector<float> s = densification_scores(state, HyperParameters{}, true);
  CHECK(s[0] > s[1]);
  CHECK(s[1] > s[2]);
}
