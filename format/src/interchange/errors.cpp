// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "quantise/axis_turns.h"
#include "stgs/format/differences.h"
#include "stgs/format/interchange.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"

namespace stgs {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

void update_max(double& a, double b) {
  a = std::max(a, b);
}

// Compares position, shape and lifespan. Adds the squared position errors to `squares`.
void compare_geometry(const Gaussians4D& expected, const Scene& actual, ConversionErrors& errors,
                      double& squares) {
  const Gaussians4D& set = actual.gaussians;
  for_each_in_part(actual, [&](std::size_t i, const TickRange& part) {
    const double position = trajectory_error(expected, i, set, i, part.end - part.begin);
    squares += position * position;
    update_max(errors.position_max, position);
    const ShapeDifference shape = shape_difference(expected, i, set, i);
    update_max(errors.log_scale_max, shape.log_scale);
    update_max(errors.rotation_max, kDegrees * shape.angle);
    const LifespanError lifespan = lifespan_error(expected, i, set, i, part);
    update_max(errors.visibility_max, lifespan.visibility);
    update_max(errors.time_max, lifespan.time);
    update_max(errors.radius_max, lifespan.radius);
    update_max(errors.sigma_max, lifespan.sigma);
  });
}

}  // namespace

Result<ConversionErrors> conversion_errors(const Gaussians4D& expected, const Scene& scene) {
  const Gaussians4D& actual = scene.gaussians;
  if (expected.size() != actual.size() || expected.sh_degree != actual.sh_degree) {
    return runtime_error(
        "read back a different set (expected {} primitives of SH degree {}, got {} of "
        "degree {})",
        expected.size(), expected.sh_degree, actual.size(), actual.sh_degree);
  }
  ConversionErrors errors;
  double position = 0, colour = 0, sh = 0;
  compare_geometry(expected, scene, errors, position);
  const auto coefficients = static_cast<std::size_t>(expected.sh_coefficients());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    errors.opacity_max =
        std::max(errors.opacity_max, std::abs(double{math::opacity_of(expected.opacity_logit[i])} -
                                              math::opacity_of(actual.opacity_logit[i])));
    for (std::size_t k = 0; k < 3 * coefficients; ++k) {
      const std::size_t at = 3 * i * coefficients + k;
      const double d = std::abs(double{expected.sh[at]} - actual.sh[at]);
      if (k < 3) {
        errors.colour_max = std::max(errors.colour_max, d * math::kSh00);
        colour += d * d * math::kSh00 * math::kSh00;
      } else {
        errors.sh_max = std::max(errors.sh_max, d);
        sh += d * d;
      }
    }
  }
  const double n = std::max<double>(1.0, static_cast<double>(expected.size()));
  errors.position_rms = std::sqrt(position / n);
  errors.colour_rms = std::sqrt(colour / (3.0 * n));
  const double rest = std::max<double>(1.0, 3.0 * static_cast<double>(coefficients - 1) * n);
  errors.sh_rms = std::sqrt(sh / rest);
  return errors;
}

}  // namespace stgs
