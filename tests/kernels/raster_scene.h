// SPDX-License-Identifier: Apache-2.0
// Random scenes in front of a camera, for the tests and benchmarks of the kernels.
#pragma once

#include <cmath>
#include <random>

#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"

namespace stgs::testing {

struct SceneShape {
  int sh_degree = 3;
  float log_scale_mean = -3.6f;  // natural log of scene units, at distances of 2 to 8
  float log_scale_spread = 0.6f;
};

// A camera off the origin, rotated about a tilted axis so that no entry of its rotation is 0 or 1.
inline math::PinholeCamera scene_camera(int width, int height) {
  math::PinholeCamera camera{};
  camera.rotation = math::rotation_of({0.98f, 0.1f, -0.15f, 0.05f});
  camera.translation = {0.1f, -0.2f, 0.3f};
  camera.fx = 0.9f * static_cast<float>(width);
  camera.fy = 0.92f * static_cast<float>(width);
  camera.cx = 0.51f * static_cast<float>(width);
  camera.cy = 0.48f * static_cast<float>(height);
  camera.width = static_cast<float>(width);
  camera.height = static_cast<float>(height);
  camera.near_plane = 0.2f;
  return camera;
}

// n primitives around t = 10, about nine in ten of them inside the view.
inline Gaussians4D random_scene(std::size_t n, const math::PinholeCamera& camera, unsigned seed,
                                const SceneShape& shape = {}) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Gaussians4D set;
  set.sh_degree = shape.sh_degree;
  set.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const float z = 2.0f + 6.0f * uniform(random);
    const float px = (uniform(random) * 1.1f - 0.05f) * camera.width;
    const float py = (uniform(random) * 1.1f - 0.05f) * camera.height;
    const math::Vec3 c{(px - camera.cx) / camera.fx * z - camera.translation.x,
                       (py - camera.cy) / camera.fy * z - camera.translation.y,
                       z - camera.translation.z};
    const math::Vec3 x = math::mat3_transpose_mul(camera.rotation, c);
    set.position[3 * i] = x.x;
    set.position[3 * i + 1] = x.y;
    set.position[3 * i + 2] = x.z;
    for (int k = 0; k < 3; ++k) {
      set.log_scale[3 * i + k] = shape.log_scale_mean + shape.log_scale_spread * normal(random);
      set.velocity[3 * i + k] = 0.002f * normal(random);
    }
    for (int k = 0; k < 4; ++k) set.rotation[4 * i + k] = normal(random);
    set.opacity_logit[i] = 1.5f * normal(random);
    const int coefficients = set.sh_coefficients();
    for (int k = 0; k < 3 * coefficients; ++k) {
      set.sh[3 * coefficients * i + k] = k < 3 ? 0.9f * normal(random) : 0.1f * normal(random);
    }
    set.time[i] = 10.0f + 6.0f * normal(random);
    set.sigma[i] = std::exp(1.0f + 0.5f * normal(random));
    set.radius[i] = 6.0f * uniform(random);
  }
  return set;
}

}  // namespace stgs::testing
