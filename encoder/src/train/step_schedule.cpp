// SPDX-License-Identifier: Apache-2.0
#include "train/step_schedule.h"

#include <algorithm>
#include <cmath>

#include "train/adam.h"

namespace stgs::encoder {
namespace {

float decayed(double first, double last, double progress) {
  if (first == 0.0) return 0.0f;
  return static_cast<float>(first * std::pow(last / first, progress));
}

}  // namespace

void set_schedule(const HyperParameters& p, const PreparedCapture& capture, double progress,
                  bool coupled, StepInput& input) {
  const double extent = capture.extent;
  input.sh_degree =
      progress < p.sh_degree * p.sh_step ? static_cast<int>(progress / p.sh_step) : p.sh_degree;
  input.kernel = p.kernel;
  input.rates[kPosition] = decayed(p.lr_position * extent, p.lr_position_final * extent, progress);
  input.rates[kVelocity] = decayed(p.lr_velocity * extent, p.lr_velocity_final * extent, progress);
  if (coupled) input.rates[kVelocity] = static_cast<float>(p.lr_rotation);
  input.rates[kLogScale] = static_cast<float>(p.lr_scale);
  input.rates[kRotation] = static_cast<float>(p.lr_rotation);
  input.rates[kOpacity] = static_cast<float>(p.lr_opacity);
  input.rates[kSh] = static_cast<float>(p.lr_sh_rest);
  input.rates[kTime] = static_cast<float>(p.lr_time);
  input.rates[kLogSigma] = static_cast<float>(p.lr_sigma);
  input.rates[kRadius] = static_cast<float>(p.lr_radius);
  // The minimum exempts moving primitives, whose initial lifespan of a few frames is long relative
  // to a short clip.
  const double static_support = std::max(p.still_from * capture.frames, p.still_least);
  input.damping = {static_cast<float>(static_support / 2),
                   static_cast<float>(p.velocity_shrink) * input.rates[kVelocity],
                   static_cast<float>(p.velocity_share)};
  input.short_lived = {0.5f * static_cast<float>(capture.frames), static_cast<float>(p.short_rate)};
  input.rate_sh0 = static_cast<float>(p.lr_sh0);
  input.rate_colour = static_cast<float>(p.lr_colour);
  input.weight_l1 = static_cast<float>(p.weight_l1);
  input.weight_ssim = static_cast<float>(p.weight_ssim);
  input.weight_lifespan = static_cast<float>(p.weight_lifespan);
  input.weight_opacity = static_cast<float>(p.weight_opacity);
  input.weight_scale = static_cast<float>(p.weight_scale / capture.scene_radius);
}

void set_batch_schedule(const HyperParameters& p, int views, StepInput& input) {
  const auto count = static_cast<float>(views);
  const float rate_factor = std::pow(count, static_cast<float>(p.batch_rate));
  for (float& rate : input.rates) rate *= rate_factor;
  input.rate_sh0 *= rate_factor;
  // A primitive is updated if any of the views shows it.
  input.short_lived.half_clip /= count;
  input.damping.shrink *= rate_factor;
  input.damping.share = std::min(1.0f, input.damping.share * rate_factor);
  const float power = std::pow(count, static_cast<float>(p.batch_memory));
  input.betas = {std::pow(kAdamBeta1, power), std::pow(kAdamBeta2, power)};
}

}  // namespace stgs::encoder
