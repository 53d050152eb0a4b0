// SPDX-License-Identifier: Apache-2.0
// Values common to all primitives of a view. Shared by slicing and the encoder's backward pass.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/raster.h"

namespace stgs::raster {

struct View {
  math::PinholeCamera camera;
  math::Vec3 centre;  // of the camera, world space
  double t;           // ticks, counted as set.time
  int coefficients;   // SH coefficients to evaluate, per channel
  int stride;         // floats per primitive in set.sh
  int kernel;         // of the splats
};

inline View view_of(const Gaussians4D& set, double t, const math::PinholeCamera& camera,
                    const RasterSettings& settings) {
  return {camera,
          math::camera_centre(camera),
          t,
          math::sh_coefficients(std::clamp(settings.max_sh_degree, 0, set.sh_degree)),
          3 * set.sh_coefficients(),
          settings.kernel};
}

// Returns entry i of an N x 3 array.
inline math::Vec3 read3(std::span<const float> array, std::size_t i) {
  return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

}  // namespace stgs::raster
