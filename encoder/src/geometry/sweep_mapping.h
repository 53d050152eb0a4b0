// SPDX-License-Identifier: Apache-2.0
// The cameras of a plane sweep, and the mappings between their pixels.
#pragma once

#include "geometry/sweep_cost.h"

namespace stgs::encoder::geometry {

// A pinhole camera: p_camera = rotation p_world + translation; rotation is row-major. Pixel centres
// are at +0.5.
struct SweepCamera {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  double rotation[9] = {}, translation[3] = {};
};

// Returns the mapping of the part of the reference that begins at pixel (x, y).
inline SweepMapping sweep_mapping(const SweepCamera& reference, const SweepCamera& source, int x,
                                  int y) {
  // The pose of the source relative to the reference.
  double rotation[3][3], translation[3];
  for (int i = 0; i < 3; ++i) {
    translation[i] = source.translation[i];
    for (int j = 0; j < 3; ++j) {
      rotation[i][j] = 0;
      for (int k = 0; k < 3; ++k)
        rotation[i][j] += source.rotation[3 * i + k] * reference.rotation[3 * j + k];
      translation[i] -= rotation[i][j] * reference.translation[j];
    }
  }
  const double ox = (x + 0.5 - reference.cx) / reference.fx;
  const double oy = (y + 0.5 - reference.cy) / reference.fy;
  SweepMapping out;
  for (int i = 0; i < 3; ++i) {
    // Row i of the intrinsic matrix of the source has `focal` at i and `centre` at 2.
    const double focal = i == 0 ? source.fx : i == 1 ? source.fy : 0;
    const double centre = i == 0 ? source.cx - 0.5 : i == 1 ? source.cy - 0.5 : 1;
    const auto projected = [&](double own, double z) { return focal * own + centre * z; };
    double m[3];
    for (int j = 0; j < 3; ++j) m[j] = projected(rotation[i][j], rotation[2][j]);
    out.x[i] = static_cast<float>(m[0] / reference.fx);
    out.y[i] = static_cast<float>(m[1] / reference.fy);
    out.base[i] = m[0] * ox + m[1] * oy + m[2];
    out.slope[i] = projected(translation[i], translation[2]);
  }
  return out;
}

}  // namespace stgs::encoder::geometry
