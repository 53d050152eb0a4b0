// SPDX-License-Identifier: Apache-2.0
#include "train/coupled_state.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace stgs::encoder {
namespace {

constexpr float kSmallestVariance = 1e-14f;  // scene units^2, of a derived axis

math::Quat read4(const std::vector<float>& array, std::size_t i) {
  const float* q = &array[4 * i];
  return {q[0], q[1], q[2], q[3]};
}

void write4(std::vector<float>& array, std::size_t i, math::Quat q) {
  array[4 * i] = q.w;
  array[4 * i + 1] = q.x;
  array[4 * i + 2] = q.y;
  array[4 * i + 3] = q.z;
}

// The shortest rotation of the x axis to a unit vector.
math::Quat rotation_from_x(math::Vec3 to) {
  if (to.x < -0.9999f) return {0.0f, 0.0f, 0.0f, 1.0f};
  return math::quat_normalised({1.0f + to.x, 0.0f, -to.z, to.y});
}

}  // namespace

// In the plane of time and the direction of motion the covariance is [[v, v w], [v w, a + v w w]]
// for the variance v of time, a of space and the speed w; across it, a. Its major axis lies at
// `angle` from time, and exp(d angle / 2) on both sides turns time there.
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
    const math::Quat turn = {static_cast<float>(std::cos(0.5 * angle)), direction.x * half_sine,
                             direction.y * half_sine, direction.z * half_sine};
    const math::Quat to_direction = rotation_from_x(direction);
    write4(coupled.left, i, math::quat_mul(turn, to_direction));
    write4(coupled.right, i, math::quat_mul(math::quat_conjugate(to_direction), turn));
    coupled.log_time[i] = static_cast<float>(0.5 * std::log(along));
    coupled.log_scale[3 * i] = static_cast<float>(0.5 * std::log(across));
    coupled.log_scale[3 * i + 1] = coupled.log_scale[3 * i + 2] = state.set.log_scale[3 * i];
    state.set.radius[i] = 0.0f;
  }
  // The moments of these attributes have another shape now.
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
  const math::Conditional conditional = math::coupled_conditional(coupled_of(state, i));
  const float tick = state.coupled.tick;
  const float u[3] = {conditional.u.x * tick, conditional.u.y * tick, conditional.u.z * tick};
  std::copy_n(u, 3, &state.set.velocity[3 * i]);
  std::copy_n(u, 3, &state.velocity[3 * i]);
  state.set.sigma[i] = conditional.sigma / tick;
  state.log_sigma[i] = std::log(state.set.sigma[i]);

  const math::Sym3& v = conditional.covariance;
  Eigen::Matrix3f covariance;
  covariance << v.xx, v.xy, v.xz, v.xy, v.yy, v.yz, v.xz, v.yz, v.zz;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver(covariance);
  Eigen::Matrix3f axes = solver.eigenvectors();
  if (axes.determinant() < 0.0f) axes.col(0) *= -1.0f;
  const Eigen::Quaternionf rotation(axes);
  write4(state.set.rotation, i, {rotation.w(), rotation.x(), rotation.y(), rotation.z()});
  for (int k = 0; k < 3; ++k) {
    const float variance = std::max(solver.eigenvalues()[k], kSmallestVariance);
    state.set.log_scale[3 * i + static_cast<std::size_t>(k)] = 0.5f * std::log(variance);
  }
}

math::Coupled coupled_backward(const TrainState& state, std::size_t i,
                               const SetGradients& gradients) {
  const float tick = state.coupled.tick;
  math::Conditional d;
  d.u = {gradients.velocity[0] * tick, gradients.velocity[1] * tick, gradients.velocity[2] * tick};
  d.sigma = gradients.sigma / tick;
  d.covariance = gradients.covariance;
  // d log s_k = axis_k' dV axis_k / (2 s_k^2); an off-diagonal entry stands for both places.
  const math::Mat3 r = math::rotation_of(read4(state.set.rotation, i));
  const math::Vec3 axes[3] = {{r.xx, r.yx, r.zx}, {r.xy, r.yy, r.zy}, {r.xz, r.yz, r.zz}};
  for (std::size_t k = 0; k < 3; ++k) {
    const float g =
        0.5f * gradients.log_scale[k] * std::exp(-2.0f * state.set.log_scale[3 * i + k]);
    const math::Vec3& a = axes[k];
    d.covariance.xx += g * a.x * a.x;
    d.covariance.yy += g * a.y * a.y;
    d.covariance.zz += g * a.z * a.z;
    d.covariance.xy += 2.0f * g * a.x * a.y;
    d.covariance.xz += 2.0f * g * a.x * a.z;
    d.covariance.yz += 2.0f * g * a.y * a.z;
  }
  const math::Coupled form = coupled_of(state, i);
  math::Coupled by = math::coupled_conditional_grad(form, d);
  by.time *= form.time;
  by.scale = {by.scale.x * form.scale.x, by.scale.y * form.scale.y, by.scale.z * form.scale.z};
  return by;
}

}  // namespace stgs::encoder
