// SPDX-License-Identifier: Apache-2.0
// From the gradients by the splats to the gradients by the primitives' parameters.
#pragma once

#include <vector>

#include "backend/cpu/blend_backward.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/raster.h"

namespace stgs::encoder::cpu {

// Gradients by the parameters of the visible primitives: entry s belongs to primitive
// frame.splats[s].id. Arrays hold their components one entry after the other.
struct PrimitiveGradients {
  int sh_coefficients = 0;           // K, as evaluated
  std::vector<float> position;       // S x 3
  std::vector<float> log_scale;      // S x 3
  std::vector<float> rotation;       // S x 4, by the quaternion as stored
  std::vector<float> opacity_logit;  // S
  std::vector<float> sh;             // S x K x 3, coefficient then channel
  std::vector<float> time;           // S, through motion and visibility
  std::vector<float> velocity;       // S x 3, by the effective velocity u = v / f
  std::vector<float> sigma;          // S, through visibility alone
  std::vector<float> radius;         // S, through visibility alone
  // By the covariance, xx xy xz yy yz zz as math::Sym3; the same as log_scale and rotation hold
  // together. Only where asked for.
  bool with_covariance = false;
  std::vector<math::Sym3> covariance;  // S

  void resize(std::size_t splats, int coefficients);
  std::size_t size() const { return opacity_logit.size(); }
};

// `frame` is the slice of `set` alone at t with these settings and id base 0; `splats` is
// blend_backward's output for it.
void project_backward(const Gaussians4D& set, float t, const math::PinholeCamera& camera,
                      const RasterSettings& settings, const SplatFrame& frame,
                      const std::vector<SplatGradients>& splats, PrimitiveGradients& out);

// For a trainer that learns v: turns out.velocity from the gradient by u = v / f(sigma, r) into the
// gradient by v. Nothing goes through f to sigma and r, for damped_velocity (math/damp.h) keeps
// u where they change.
void modulation_backward(const Gaussians4D& set, const SplatFrame& frame, PrimitiveGradients& out);

}  // namespace stgs::encoder::cpu
