// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "axis_turns.h"
#include "stgs/format/differences.h"
#include "stgs/format/interchange.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"

namespace stgs {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

void keep_larger(double& a, double b) {
  a = std::max(a, b);
}

// Place, shape and time. Adds to `squares`, of positions.
void compare_geometry(const Gaussians4D& meant, const Scene& got, ConversionErrors& errors,
                      double& squares) {
  const Gaussians4D& set = got.gaussians;
  for_each_in_part(got, [&](std::size_t i, const TickRange& part) {
    const double position = trajectory_error(meant, i, set, i, part.end - part.begin);
    squares += position * position;
    keep_larger(errors.position_max, position);
    const ShapeDifference shape = shape_difference(meant, i, set, i);
    keep_larger(errors.log_scale_max, shape.log_scale);
    keep_larger(errors.rotation_max, kDegrees * shape.angle);
    const LifespanError lifespan = lifespan_error(meant, i, set, i, part);
    keep_larger(errors.visibility_max, lifespan.visibility);
    keep_larger(errors.time_max, lifespan.time);
    keep_larger(errors.radius_max, lifespan.radius);
    keep_larger(errors.sigma_max, lifespan.sigma);
  });
}

}  // namespace

Result<ConversionErrors> conversion_errors(const Gaussians4D& meant, const Scene& read) {
  const Gaussians4D& got = read.gaussians;
  if (meant.size() != got.size() || meant.sh_degree != got.sh_degree) {
    return runtime_error("{} primitives of degree {} were written, {} of degree {} came back",
                         meant.size(), meant.sh_degree, got.size(), got.sh_degree);
  }
  ConversionErrors errors;
  double position = 0, colour = 0, harmonics = 0;
  compare_geometry(meant, read, errors, position);
  const auto coefficients = static_cast<std::size_t>(meant.sh_coefficients());
  for (std::size_t i = 0; i < meant.size(); ++i) {
    errors.opacity_max =
        std::max(errors.opacity_max, std::abs(double{math::opacity_of(meant.opacity_logit[i])} -
                                              math::opacity_of(got.opacity_logit[i])));
    for (std::size_t k = 0; k < 3 * coefficients; ++k) {
      const std::size_t at = 3 * i * coefficients + k;
      const double d = std::abs(double{meant.sh[at]} - got.sh[at]);
      if (k < 3) {
        errors.colour_max = std::max(errors.colour_max, d * math::kSh00);
        colour += d * d * math::kSh00 * math::kSh00;
      } else {
        errors.sh_max = std::max(errors.sh_max, d);
        harmonics += d * d;
      }
    }
  }
  const double n = std::max<double>(1.0, static_cast<double>(meant.size()));
  errors.position_rms = std::sqrt(position / n);
  errors.colour_rms = std::sqrt(colour / (3.0 * n));
  const double rest = std::max<double>(1.0, 3.0 * static_cast<double>(coefficients - 1) * n);
  errors.sh_rms = std::sqrt(harmonics / rest);
  return errors;
}

}  // namespace stgs
