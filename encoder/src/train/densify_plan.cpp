// SPDX-License-Identifier: Apache-2.0
#include "train/densify_plan.h"

#include <algorithm>

namespace stgs::encoder {

DensifyPlan densify_plan(const HyperParameters& p, const Ablation& ablation, double share,
                         bool interval) {
  DensifyPlan plan;
  const bool begun = share >= p.densify_from;
  plan.second_stage = share >= p.stage1_until;
  if (!ablation.densification) {
    plan.gather = share < p.plain_until;
    plan.grow = interval && begun && plan.gather;
    plan.resets_due =
        p.plain_reset > 0 ? static_cast<int>(std::min(share / p.plain_reset, 1e6)) : 0;
    return plan;
  }
  plan.gather = share < p.densify_until;
  const bool now = interval && begun && plan.gather;
  plan.grow = now && !plan.second_stage;
  plan.replace = now && plan.second_stage;
  if (p.stage1_until > 0) {
    plan.resets_due =
        static_cast<int>(std::min(share / p.stage1_until * (p.opacity_resets + 1), 1e6));
  }
  return plan;
}

}  // namespace stgs::encoder
