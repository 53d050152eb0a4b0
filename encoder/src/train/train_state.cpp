// SPDX-License-Identifier: Apache-2.0
#include "train_state.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"
#include "train/coupled_state.h"

namespace stgs::encoder {

void DensifyStatistics::reset(std::size_t n) {
  gradient_sum.assign(n, 0.0f);
  abs_gradient_sum.assign(n, 0.0f);
  error_max.assign(n, 0.0f);
  views.assign(n, 0);
}

int TrainState::components(int attribute) const {
  switch (attribute) {
    case kRotation:
      return 4;
    case kVelocity:
      return is_coupled() ? 4 : 3;
    case kPosition:
    case kLogScale:
      return 3;
    case kSh:
      return 3 * set.sh_coefficients();
    default:
      return 1;
  }
}

const FloatArray& TrainState::values(int attribute) const {
  switch (attribute) {
    case kPosition:
      return set.position;
    case kLogScale:
      return is_coupled() ? coupled.log_scale : set.log_scale;
    case kRotation:
      return is_coupled() ? coupled.left : set.rotation;
    case kOpacity:
      return set.opacity_logit;
    case kSh:
      return set.sh;
    case kTime:
      return set.time;
    case kVelocity:
      return is_coupled() ? coupled.right : velocity;
    case kLogSigma:
      return is_coupled() ? coupled.log_time : log_sigma;
    default:
      return set.radius;
  }
}

FloatArray& TrainState::values(int attribute) {
  return const_cast<FloatArray&>(std::as_const(*this).values(attribute));
}

Gaussians4D rounded_set(const TrainState& state) {
  Gaussians4D out = state.set;
  const CompactionState& compaction = state.compaction;
  parallel_for(std::size_t{0}, state.size(), [&](std::size_t i) {
    if (state.is_fixed(i)) return;
    round_primitive(state.set, compaction.rules, compaction.tier[i], i, out);
  });
  return out;
}

std::vector<std::uint32_t> TrainState::list_trained() const {
  std::vector<std::uint32_t> out;
  for (std::size_t i = 0; i < size(); ++i) {
    if (!is_fixed(i)) out.push_back(static_cast<std::uint32_t>(i));
  }
  return out;
}

std::size_t TrainState::count_fixed() const {
  return static_cast<std::size_t>(std::count(updates.begin(), updates.end(), kFixed));
}

void TrainState::resize(std::size_t n) {
  set.resize(n);
  velocity.resize(3 * n, 0.0f);
  log_sigma.resize(n, 0.0f);
  if (is_coupled()) {
    for (int a : {kLogScale, kRotation, kVelocity, kLogSigma}) {
      values(a).resize(n * components(a), 0.0f);
    }
  }
  for (int a = 0; a < kAttributes; ++a) {
    moments[a].first.resize(n * components(a), 0.0f);
    moments[a].second.resize(n * components(a), 0.0f);
  }
  updates.resize(n, 0);
  statistics.gradient_sum.resize(n, 0.0f);
  statistics.abs_gradient_sum.resize(n, 0.0f);
  statistics.error_max.resize(n, 0.0f);
  statistics.views.resize(n, 0);
}

TrainState TrainState::without_primitives() const {
  TrainState out;
  out.set.sh_degree = set.sh_degree;
  out.coupled.tick = coupled.tick;
  out.background = background;
  out.colour = colour;
  out.colour_first = colour_first;
  out.colour_second = colour_second;
  out.colour_updates = colour_updates;
  out.cameras = cameras;
  out.cameras_first.assign(cameras.size(), CameraCorrection{});
  out.cameras_second = out.camera_sums = out.cameras_first;
  out.camera_updates.assign(cameras.size(), 0);
  out.camera_views.assign(cameras.size(), 0);
  return out;
}

void TrainState::damp(std::size_t i, float before, bool modulated,
                      const math::DampingRules& rules) {
  float* v = &velocity[3 * i];
  const float sigma = std::exp(log_sigma[i]), radius = set.radius[i];
  const float ratio = modulated ? math::lifespan_modulation(sigma, radius) / before : 1.0f;
  const math::Vec3 damped = math::damped_velocity({v[0], v[1], v[2]}, ratio, sigma, radius, rules);
  v[0] = damped.x;
  v[1] = damped.y;
  v[2] = damped.z;
}

void TrainState::derive(std::size_t i, bool modulated) {
  if (is_coupled()) {
    derive_from_coupled(*this, i);
    return;
  }
  const float sigma = std::exp(log_sigma[i]);
  const float f = modulated ? math::lifespan_modulation(sigma, set.radius[i]) : 1.0f;
  set.sigma[i] = sigma;
  for (int c = 0; c < 3; ++c) set.velocity[3 * i + c] = velocity[3 * i + c] / f;
}

void TrainState::derive_all(bool modulated) {
  for (std::size_t i = 0; i < size(); ++i) derive(i, modulated);
}

void TrainState::retain(const std::vector<std::uint32_t>& indices) {
  const auto gather = [&indices](auto& array, std::size_t components) {
    std::remove_reference_t<decltype(array)> retained;
    gather_rows(array, components, indices, retained);
    array = std::move(retained);
  };
  set = set.gather(indices);
  gather(velocity, 3);
  gather(log_sigma, 1);
  if (is_coupled()) {
    for (int a : {kLogScale, kRotation, kVelocity, kLogSigma}) gather(values(a), components(a));
  }
  for (int a = 0; a < kAttributes; ++a) {
    gather(moments[a].first, components(a));
    gather(moments[a].second, components(a));
  }
  gather(updates, 1);
  if (compaction.is_rounding()) {
    gather(compaction.importance, 1);
    gather(compaction.tier, 1);
  }
  gather(statistics.gradient_sum, 1);
  gather(statistics.abs_gradient_sum, 1);
  gather(statistics.error_max, 1);
  gather(statistics.views, 1);
}

void TrainState::copy_parameters(const TrainState& from, std::size_t begin, std::size_t end,
                                 std::size_t to) {
  const auto copy = [&](const FloatArray& source, FloatArray& target, std::size_t n) {
    std::copy_n(source.data() + begin * n, (end - begin) * n, target.data() + to * n);
  };
  for (int a = 0; a < kAttributes; ++a)
    copy(from.values(a), values(a), static_cast<std::size_t>(components(a)));
  copy(from.set.velocity, set.velocity, 3);
  copy(from.set.sigma, set.sigma, 1);
  if (!is_coupled()) return;
  copy(from.set.log_scale, set.log_scale, 3);
  copy(from.set.rotation, set.rotation, 4);
  copy(from.velocity, velocity, 3);
  copy(from.log_sigma, log_sigma, 1);
}

void TrainState::clear_moments(std::size_t i) {
  for (int a = 0; a < kAttributes; ++a) {
    const std::size_t n = components(a);
    std::fill_n(moments[a].first.begin() + static_cast<std::ptrdiff_t>(i * n), n, 0.0f);
    std::fill_n(moments[a].second.begin() + static_cast<std::ptrdiff_t>(i * n), n, 0.0f);
  }
  updates[i] = 0;
}

void TrainState::copy_parameters(std::size_t from, std::size_t to) {
  const auto copy = [from, to](FloatArray& array, std::size_t components) {
    std::copy_n(array.begin() + static_cast<std::ptrdiff_t>(from * components), components,
                array.begin() + static_cast<std::ptrdiff_t>(to * components));
  };
  for (int a = 0; a < kAttributes; ++a) copy(values(a), components(a));
  copy(set.velocity, 3);
  copy(set.sigma, 1);
  if (is_coupled()) {
    copy(set.log_scale, 3);
    copy(set.rotation, 4);
    copy(velocity, 3);
    copy(log_sigma, 1);
  }
  clear_moments(to);
}

}  // namespace stgs::encoder
