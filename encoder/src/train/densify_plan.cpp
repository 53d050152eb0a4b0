// SPDX-License-Identifier: Apache-2.0
#include "train/densify_plan.h"

#include <algorithm>

namespace stgs::encoder {

DensifyPlan densify_plan(const HyperParameters& p, const Ablation& ablation, double progress,
                         bool interval) {
  DensifyPlan plan;
  const bool started = progress >= p.densify_from;
  plan.second_stage = progress >= p.stage1_until;
  if (ablation.densification == Densification::kPlain) {
    plan.gather = progress < p.plain_until;
    plan.grow = interval && started && plan.gather;
    plan.resets_due =
        p.plain_reset > 0 ? static_cast<int>(std::min(progress / p.plain_reset, 1e6)) : 0;
    return plan;
  }
  plan.gather = progress < p.densify_until;
  const bool due = interval && started && plan.gather;
  if (ablation.densification == Densification::kRelocation) {
    plan.second_stage = true;
    plan.relocate = due;
    return plan;
  }
  plan.grow = due && !plan.second_stage;
  plan.replace = due && plan.second_stage;
  if (p.stage1_until > 0) {
    plan.resets_due =
        static_cast<int>(std::min(progress / p.stage1_until * (p.opacity_resets + 1), 1e6));
  }
  return plan;
}

}  // namespace stgs::encoder
