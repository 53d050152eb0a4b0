// SPDX-License-Identifier: Apache-2.0
#include "quantise/axis_turns.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/surface.h"

namespace stgs {
namespace {

using Quaternion = std::array<double, 4>;

// The 24 rotations that map the axes onto each other, with one of the two quaternions of each. The
// identity is first.
constexpr std::array<Quaternion, 24> make_axis_turns() {
  constexpr double kRoot = 0.70710678118654752440;
  std::array<Quaternion, 24> out{};
  std::size_t n = 0;
  for (std::size_t a = 0; a < 4; ++a) {
    out[n++][a] = 1.0;
    for (std::size_t b = a + 1; b < 4; ++b) {
      for (const double sign : {1.0, -1.0}) {
        out[n][a] = kRoot;
        out[n++][b] = sign * kRoot;
      }
    }
  }
  for (int signs = 0; signs < 8; ++signs) {
    out[n++] = {0.5, (signs & 1) != 0 ? -0.5 : 0.5, (signs & 2) != 0 ? -0.5 : 0.5,
                (signs & 4) != 0 ? -0.5 : 0.5};
  }
  return out;
}
constexpr std::array<Quaternion, 24> kAxisTurns = make_axis_turns();

double dot(const Quaternion& a, const Quaternion& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

// Returns a times the inverse of the unit quaternion b.
Quaternion times_inverse(const Quaternion& a, const Quaternion& b) {
  return {dot(a, b), a[1] * b[0] - a[0] * b[1] - a[2] * b[3] + a[3] * b[2],
          a[2] * b[0] - a[0] * b[2] - a[3] * b[1] + a[1] * b[3],
          a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1]};
}

Quaternion inverse(const Quaternion& q) {
  return {q[0], -q[1], -q[2], -q[3]};
}

Quaternion unit_rotation(const Gaussians4D& set, std::size_t i) {
  const float* stored = set.rotation.data() + 4 * i;
  Quaternion q{stored[0], stored[1], stored[2], stored[3]};
  const double length = std::sqrt(dot(q, q));
  for (double& v : q) v /= length;
  return q;
}

// Returns the axis that a rotation maps an axis to.
std::size_t turned_axis(const Quaternion& turn, std::size_t axis) {
  const math::Mat3 m =
      math::rotation_of({static_cast<float>(turn[0]), static_cast<float>(turn[1]),
                         static_cast<float>(turn[2]), static_cast<float>(turn[3])});
  const math::Vec3 on = math::mat3_column(m, static_cast<int>(axis));
  return std::abs(on.x) > 0.5f ? 0 : std::abs(on.y) > 0.5f ? 1 : 2;
}

using TurnedAxes = std::array<std::array<std::size_t, 3>, 24>;

const TurnedAxes& turned_axes() {
  static const TurnedAxes axes = [] {
    TurnedAxes out{};
    for (std::size_t t = 0; t < 24; ++t) {
      for (std::size_t k = 0; k < 3; ++k) out[t][k] = turned_axis(kAxisTurns[t], k);
    }
    return out;
  }();
  return axes;
}

// Returns the element of kAxisTurns nearest to a rotation; the first of equally near ones.
std::size_t nearest_turn(const Quaternion& q) {
  std::size_t best = 0;
  double best_dot = -1.0;
  for (std::size_t t = 0; t < 24; ++t) {
    const double near = std::abs(dot(q, kAxisTurns[t]));
    if (near > best_dot + 1e-6) {
      best_dot = near;
      best = t;
    }
  }
  return best;
}

}  // namespace

void minimise_rotations(Gaussians4D& set) {
  const TurnedAxes& axes = turned_axes();
  for (std::size_t i = 0; i < set.size(); ++i) {
    float* stored = set.rotation.data() + 4 * i;
    const Quaternion q{stored[0], stored[1], stored[2], stored[3]};
    const std::size_t turn = nearest_turn(q);
    const Quaternion reduced = times_inverse(q, kAxisTurns[turn]);
    const double scale = std::copysign(1.0 / std::sqrt(dot(reduced, reduced)), reduced[0]);
    for (std::size_t c = 0; c < 4; ++c) stored[c] = static_cast<float>(scale * reduced[c]);
    float* sizes = set.log_scale.data() + 3 * i;
    const std::array<float, 3> before{sizes[0], sizes[1], sizes[2]};
    for (std::size_t k = 0; k < 3; ++k) sizes[axes[turn][k]] = before[k];
  }
}

ShapeDifference shape_difference(const Gaussians4D& a, std::size_t i, const Gaussians4D& b,
                                 std::size_t j) {
  // From the axes of a's Gaussian to those of b's.
  const Quaternion between =
      times_inverse(inverse(unit_rotation(b, j)), inverse(unit_rotation(a, i)));
  const std::size_t turn = nearest_turn(between);
  const Quaternion& near = kAxisTurns[turn];
  const double sign = std::copysign(1.0, dot(between, near));
  double chord = 0.0;  // well-conditioned for small angles, unlike the arc cosine
  for (std::size_t c = 0; c < 4; ++c) {
    chord += (sign * between[c] - near[c]) * (sign * between[c] - near[c]);
  }
  ShapeDifference out;
  out.angle = 4.0 * std::asin(std::min(1.0, 0.5 * std::sqrt(chord)));
  for (std::size_t k = 0; k < 3; ++k) {
    const double d = double{a.log_scale[3 * i + k]} - b.log_scale[3 * j + turned_axes()[turn][k]];
    out.log_scales[k] = std::abs(d);
    out.log_scale = std::max(out.log_scale, out.log_scales[k]);
  }
  return out;
}

}  // namespace stgs
