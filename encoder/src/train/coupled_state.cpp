// SPDX-License-Identifier: Apache-2.0
#include "train/coupled_state.h"

#include <algorithm>
#include <cmath>
#include <span>

namespace stgs::encoder {
namespace {

math::Quat read4(std::span<const float> array, std::size_t i) {
  const float* q = &array[4 * i];
  return {q[0], q[1], q[2], q[3]};
}

void write4(std::span<float> array, std::size_t i, math::Quat q) {
  array[4 * i] = q.w;
  array[4 * i + 1] = q.x;
  array[4 * i + 2] = q.y;
  array[4 * i + 3] = q.z;
}

// Returns the shortest rotation of the x axis to a unit vector.
math::Quat rotation_from_x(math::Vec3 to) {
  if (to.x < -0.9999f) return {0.0f, 0.0f, 0.0f, 1.0f};
  return math::quat_normalised({1.0f + to.x, 0.0f, -to.z, to.y});
}

}  // namespace

// In the plane of time and the direction of motion d the covariance is [[v, v w], [v w, a + v w
// w]], with the variances v of time and a of space and the speed w; perpendicular to it, a. Its
// major axis lies at `angle` from time, and exp(d angle / 2) on both sides rotates time onto it.
void start_coupled(TrainState& state, float tick) {
  CoupledParameters& coupled = state.coupled;
  coupled.tick = tick;
  const std::size_t n = state.size();
  state.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const float* u = &state.set.velocity[3 * i];
    const float speed = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    const math::Vec3 direction = speed > 0.0f ? math::Vec3{u[0] / speed, u[1] / speed, u[2] / speed}
                                              : math::Vec3{1.0f, 0.0f, 0.0f};
    const double w = speed / tick;
    const double sigma = static_cast<double>(state.set.sigma[i]) * tick;
    const double v = 0.5 * sigma * sigma;
    const double a = std::exp(2.0 * state.set.log_scale[3 * i]);
    const double angle = 0.5 * std::atan2(2 * v * w, v - a - v * w * w);
    const double c = std::cos(angle), s = std::sin(angle);
    const double along = v * c * c + 2 * v * w * c * s + (a + v * w * w) * s * s;
    const double across = v * s * s - 2 * v * w * c * s + (a + v * w * w) * c * c;
    const auto half_sine = static_cast<float>(std::sin(0.5 * angle));
    const math::Quat half_turn = {static_cast<float>(std::cos(0.5 * angle)),
                                  direction.x * half_sine, direction.y * half_sine,
                                  direction.z * half_sine};
    const math::Quat to_direction = rotation_from_x(direction);
    write4(coupled.left, i, math::quat_mul(half_turn, to_direction));
    write4(coupled.right, i, math::quat_mul(math::quat_conjugate(to_direction), half_turn));
    coupled.log_time[i] = static_cast<float>(0.5 * std::log(along));
    coupled.log_scale[3 * i] = static_cast<float>(0.5 * std::log(across));
    coupled.log_scale[3 * i + 1] = coupled.log_scale[3 * i + 2] = state.set.log_scale[3 * i];
    state.set.radius[i] = 0.0f;
  }
  // The Adam moments of these attributes change shape.
  for (int attribute : {kLogScale, kRotation, kVelocity, kLogSigma}) {
    const std::size_t size = n * static_cast<std::size_t>(state.components(attribute));
    state.moments[attribute].first.assign(size, 0.0f);
    state.moments[attribute].second.assign(size, 0.0f);
  }
}

math::Coupled coupled_of(const TrainState& state, std::size_t i) {
  const CoupledParameters& c = state.coupled;
  const float* s = &c.log_scale[3 * i];
  return {read4(c.left, i),
          read4(c.right, i),
          std::exp(c.log_time[i]),
          {std::exp(s[0]), std::exp(s[1]), std::exp(s[2])}};
}

void derive_from_coupled(TrainState& state, std::size_t i) {
  const math::CoupledPrimitive primitive =
      math::coupled_primitive(coupled_of(state, i), state.coupled.tick);
  const float u[3] = {primitive.u.x, primitive.u.y, primitive.u.z};
  std::copy_n(u, 3, &state.set.velocity[3 * i]);
  std::copy_n(u, 3, &state.velocity[3 * i]);
  state.set.sigma[i] = primitive.sigma;
  state.log_sigma[i] = std::log(primitive.sigma);
  write4(state.set.rotation, i, primitive.rotation);
  const float log_scale[3] = {primitive.log_scale.x, primitive.log_scale.y, primitive.log_scale.z};
  std::copy_n(log_scale, 3, &state.set.log_scale[3 * i]);
}

math::Coupled coupled_backward(const TrainState& state, std::size_t i,
                               const math::CoupledPrimitiveGrad& by) {
  const float* s = &state.set.log_scale[3 * i];
  return math::coupled_primitive_grad(coupled_of(state, i), state.coupled.tick, {s[0], s[1], s[2]},
                                      read4(state.set.rotation, i), by);
}

}  // namespace stgs::encoder
