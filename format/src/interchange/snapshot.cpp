// SPDX-License-Identifier: Apache-2.0
// Snapshots of a scene, and changes of axes.
#include <algorithm>
#include <array>
#include <cmath>

#include "stgs/format/interchange.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

// Primitives [first, last) of a part that is displayed at a time (spec 5.4), and that time in ticks
// of the part.
struct ShownPart {
  std::size_t first = 0, last = 0;
  double ticks = 0;
};
std::vector<ShownPart> parts_at(const Scene& scene, double ticks) {
  if (scene.parts.empty()) return {{0, scene.gaussians.size(), ticks}};
  std::vector<ShownPart> out;
  std::size_t first = 0;
  for (const ScenePart& part : scene.parts) {
    const std::size_t last = first + static_cast<std::size_t>(part.primitives);
    if (part.shows(ticks, scene.metadata.frames))
      out.push_back({first, last, ticks - part.begin_ticks});
    first = last;
  }
  return out;
}

// Returns the logit of O l; exactly that of O if l is 1.
float faded_logit(float logit, float visibility) {
  if (visibility >= 1.0f) return logit;
  // O l / (1 - O l) with O = 1 / (1 + e^-o), without the cancellation of 1 - O.
  const double l = visibility;
  return static_cast<float>(std::log(l) - std::log1p(-l + std::exp(-double{logit})));
}

}  // namespace

void set_static_lifespan(Gaussians4D& set, std::uint32_t frames) {
  const auto clip = static_cast<float>(frames);
  std::fill(set.time.begin(), set.time.end(), 0.5f * clip);
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 1.0f);
  std::fill(set.radius.begin(), set.radius.end(), clip);
}

Scene static_scene(Gaussians4D set) {
  Scene scene;
  scene.metadata.frames = 1;
  set_static_lifespan(set, scene.metadata.frames);
  scene.gaussians = std::move(set);
  return scene;
}

Result<Gaussians4D> snapshot_at(const Scene& scene, double ticks) {
  if (!(ticks >= 0.0 && ticks <= scene.metadata.frames)) {
    const TimeBase& base = scene.metadata.time_base;
    return usage_error("time {} s is outside the scene (expected 0 to {} s)", base.seconds(ticks),
                       base.seconds(scene.metadata.frames));
  }
  const Gaussians4D& set = scene.gaussians;
  std::vector<std::uint32_t> visible;
  FloatArray logits;
  std::vector<float> ages;  // t - T
  for (const ShownPart& part : parts_at(scene, ticks)) {
    for (std::size_t i = part.first; i < part.last; ++i) {
      const auto dt = static_cast<float>(part.ticks - set.time[i]);
      const float l = math::visibility(dt, set.sigma[i], set.radius[i]);
      if (math::opacity_of(set.opacity_logit[i]) * l < math::kAlphaThreshold) continue;
      visible.push_back(static_cast<std::uint32_t>(i));
      logits.push_back(faded_logit(set.opacity_logit[i], l));
      ages.push_back(dt);
    }
  }
  Gaussians4D out = set.gather(visible);
  out.opacity_logit = std::move(logits);
  for (std::size_t i = 0; i < out.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      out.position[3 * i + c] += out.velocity[3 * i + c] * ages[i];
    }
  }
  set_static_lifespan(out);
  return out;
}

void flip_axes(Gaussians4D& set, int x, int y, int z) {
  const std::array<float, 3> sign = {x < 0 ? -1.0f : 1.0f, y < 0 ? -1.0f : 1.0f,
                                     z < 0 ? -1.0f : 1.0f};
  // Each basis function is even or odd in each axis, so Y_k(F d) = s_k Y_k(d) for every d. The
  // signs are determined at a direction where no basis function is 0.
  const math::Vec3 d = math::vec3_of(0.36f, 0.48f, 0.8f);
  const math::ShBasis before = math::sh_basis(d);
  const math::ShBasis after =
      math::sh_basis(math::vec3_of(sign[0] * d.x, sign[1] * d.y, sign[2] * d.z));
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  std::array<float, math::kShMaxCoefficients> sh_sign{};
  for (std::size_t k = 0; k < coefficients; ++k) {
    sh_sign[k] = (before.v[k] < 0.0f) == (after.v[k] < 0.0f) ? 1.0f : -1.0f;
  }
  // The rotation becomes F R(q) F and the scales stay, because F S F = S: the vector part of q
  // transforms as an axial vector.
  const std::array<float, 4> q_sign = {1.0f, sign[1] * sign[2], sign[0] * sign[2],
                                       sign[0] * sign[1]};
  parallel_blocks(std::size_t{0}, set.size(), kPrimitivesPerTask,
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t i = first; i < last; ++i) {
                      for (std::size_t c = 0; c < 3; ++c) {
                        set.position[3 * i + c] *= sign[c];
                        set.velocity[3 * i + c] *= sign[c];
                      }
                      for (std::size_t c = 0; c < 4; ++c) set.rotation[4 * i + c] *= q_sign[c];
                      for (std::size_t k = 0; k < coefficients; ++k) {
                        for (std::size_t c = 0; c < 3; ++c)
                          set.sh[(i * coefficients + k) * 3 + c] *= sh_sign[k];
                      }
                    }
                  });
}

}  // namespace stgs
