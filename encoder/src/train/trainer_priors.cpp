// SPDX-License-Identifier: Apache-2.0
// The priors of a sparse rig, and the limit of the scales.
#include <algorithm>

#include "train/free_space.h"
#include "train/rig.h"
#include "train/trainer.h"

namespace stgs::encoder {

Status Trainer::prepare_priors() {
  const double sparsity = rig_sparsity(capture_);
  const bool sets_start = std::any_of(settings_.overrides.begin(), settings_.overrides.end(),
                                      [](const auto& set) { return set.first == "normal_from"; });
  if (sets_start && growth_.weight_normal == 0) {
    return usage_error(
        "--set normal_from has no effect, because L_n is off for rigs with many or close cameras; "
        "set weight_normal, too, or remove it");
  }
  // The other densifications are as published.
  if (ablation_.densification == Densification::kScored) {
    STGS_ASSIGN(free_space_, find_free_space(capture_));
  }
  if (sparsity > 0 && ablation_.densification == Densification::kScored) {
    log_(2, fmt::format("sparse rig ({:.2f} of 1): L_n has weight {:.3g}, and space in front of {} "
                        "views is kept empty",
                        sparsity, growth_.weight_normal, free_space_.count));
  }
  return {};
}

Status Trainer::limit_scales() {
  const int interval = std::max(1, parameters_.densify_interval / 2);
  if (!limits_scales() || !(passed(static_cast<std::uint64_t>(interval)) || finished())) return {};
  STGS_TRY(read_steps());
  std::vector<math::PinholeCamera> cameras;
  for (const Camera& camera : images_.cameras())
    cameras.push_back(camera.pinhole(capture_.near_plane));
  return backend_->limit_scales(cameras, static_cast<float>(parameters_.min_scale));
}

}  // namespace stgs::encoder
