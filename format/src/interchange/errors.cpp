// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "interchange/rotation_angle.h"
#include "stgs/format/interchange.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"

namespace stgs {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

}  // namespace

Result<ConversionErrors> conversion_errors(const Gaussians4D& meant, const Gaussians4D& got) {
  if (meant.size() != got.size() || meant.sh_degree != got.sh_degree) {
    return runtime_error("{} primitives of degree {} were written, {} of degree {} came back",
                         meant.size(), meant.sh_degree, got.size(), got.sh_degree);
  }
  ConversionErrors errors;
  double position = 0, colour = 0, harmonics = 0;
  const auto coefficients = static_cast<std::size_t>(meant.sh_coefficients());
  for (std::size_t i = 0; i < meant.size(); ++i) {
    double squared = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d = double{meant.position[3 * i + c]} - got.position[3 * i + c];
      squared += d * d;
      errors.log_scale_max =
          std::max(errors.log_scale_max,
                   std::abs(double{meant.log_scale[3 * i + c]} - got.log_scale[3 * i + c]));
    }
    position += squared;
    errors.position_max = std::max(errors.position_max, std::sqrt(squared));
    errors.rotation_max = std::max(
        errors.rotation_max,
        kDegrees * rotation_angle(meant.rotation.data() + 4 * i, got.rotation.data() + 4 * i));
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
        errors.harmonics_max = std::max(errors.harmonics_max, d);
        harmonics += d * d;
      }
    }
  }
  const double n = std::max<double>(1.0, static_cast<double>(meant.size()));
  errors.position_rms = std::sqrt(position / n);
  errors.colour_rms = std::sqrt(colour / (3.0 * n));
  const double rest = std::max<double>(1.0, 3.0 * static_cast<double>(coefficients - 1) * n);
  errors.harmonics_rms = std::sqrt(harmonics / rest);
  return errors;
}

}  // namespace stgs
