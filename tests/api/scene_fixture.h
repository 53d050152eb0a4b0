// SPDX-License-Identifier: Apache-2.0
// Random scenes whose parameters are distributed as in trained scenes.
#pragma once

#include <cmath>
#include <cstring>
#include <random>
#include <string>

#include "stgs/format/scene_file.h"

namespace stgs::testing {

// n primitives in a box of 4 units in front of the camera: 60 % static and long-lived, the rest
// moving and short-lived.
inline Scene random_scene(std::size_t n, int sh_degree, std::uint32_t frames, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Scene scene;
  scene.metadata.time_base = {1, 30};
  scene.metadata.frames = frames;
  scene.metadata.generator = "test";
  scene.metadata.title = "random scene";
  scene.metadata.near_plane = 0.1f;
  Gaussians4D& set = scene.gaussians;
  set.sh_degree = sh_degree;
  set.resize(n);
  const auto clip = static_cast<float>(frames);
  for (std::size_t i = 0; i < n; ++i) {
    const bool is_static = uniform(random) < 0.6f;
    for (std::size_t c = 0; c < 3; ++c) {
      set.position[3 * i + c] = 4.0f * uniform(random) - 2.0f + (c == 2 ? 5.0f : 0.0f);
      set.log_scale[3 * i + c] = -3.6f + 0.7f * normal(random);
      set.velocity[3 * i + c] = is_static ? 1e-6f * normal(random) : 0.02f * normal(random);
    }
    for (std::size_t c = 0; c < 4; ++c) set.rotation[4 * i + c] = normal(random);
    set.opacity_logit[i] = 2.2f * normal(random);
    const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
    const float sh_scale = std::exp(0.5f * normal(random));  // a few primitives are glossy
    for (std::size_t k = 0; k < coefficients; ++k) {
      const float spread = k == 0 ? 0.8f : sh_scale * (k < 4 ? 0.05f : k < 9 ? 0.03f : 0.02f);
      const float shared = normal(random);
      for (std::size_t c = 0; c < 3; ++c) {
        set.sh[(i * coefficients + k) * 3 + c] = spread * (0.92f * shared + 0.39f * normal(random));
      }
    }
    set.time[i] = is_static ? 0.5f * clip : clip * uniform(random);
    set.sigma[i] = is_static ? clip * (1.0f + uniform(random)) : 1.0f + 3.0f * uniform(random);
    set.radius[i] = uniform(random) < 0.5f ? 1e-6f : 4.0f * uniform(random);
  }
  return scene;
}

// The bytes of each primitive, for comparing sets regardless of order.
inline std::vector<std::string> fingerprints(const Gaussians4D& set) {
  std::vector<std::string> out(set.size());
  const auto add = [&out](const FloatArray& array, std::size_t components) {
    for (std::size_t i = 0; i < out.size(); ++i) {
      const auto* bytes = reinterpret_cast<const char*>(array.data() + i * components);
      out[i].append(bytes, components * sizeof(float));
    }
  };
  add(set.position, 3);
  add(set.log_scale, 3);
  add(set.rotation, 4);
  add(set.opacity_logit, 1);
  add(set.sh, 3 * static_cast<std::size_t>(set.sh_coefficients()));
  add(set.time, 1);
  add(set.velocity, 3);
  add(set.sigma, 1);
  add(set.radius, 1);
  return out;
}

}  // namespace stgs::testing
