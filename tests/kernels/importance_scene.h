// SPDX-License-Identifier: Apache-2.0
// Views of a random scene, for the tests of importances.
#pragma once

#include <vector>

#include "raster_scene.h"
#include "train/importance.h"

namespace stgs::testing {

// Five times around t = 10, each from another camera position, with both kernels.
inline std::vector<encoder::ImportanceView> importance_scene_views(int width, int height) {
  std::vector<encoder::ImportanceView> views;
  for (int v = 0; v < 5; ++v) {
    math::PinholeCamera camera = scene_camera(width, height);
    camera.translation.x += 0.1f * static_cast<float>(v);
    views.push_back({camera, 8.0f + static_cast<float>(v), v % 2});
  }
  return views;
}

}  // namespace stgs::testing
