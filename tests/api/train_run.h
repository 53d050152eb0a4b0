// SPDX-License-Identifier: Apache-2.0
// Short training runs on the synthetic capture, and comparison of their results.
#pragma once

#include "stgs/encoder/train.h"
#include "synthetic_capture.h"

namespace stgs::test {

inline encoder::TrainSettings short_run(int iterations) {
  encoder::TrainSettings settings;
  settings.preset = "fast";
  settings.iterations = iterations;
  settings.max_primitives = 600;
  settings.overrides = {{"densify_interval", "20"}, {"sh_degree", "1"}};
  return settings;
}

// Whether two sets are equal to the bit, in the same order.
inline bool same(const Gaussians4D& a, const Gaussians4D& b) {
  return a.position == b.position && a.log_scale == b.log_scale && a.rotation == b.rotation &&
         a.opacity_logit == b.opacity_logit && a.sh == b.sh && a.time == b.time &&
         a.velocity == b.velocity && a.sigma == b.sigma && a.radius == b.radius;
}

inline Result<Scene> run(const SyntheticCapture& synthetic, const encoder::TrainSettings& settings,
                         const encoder::ProgressSink& progress = nullptr) {
  return encoder::train(synthetic.capture, settings, progress, nullptr, nullptr);
}

}  // namespace stgs::test
