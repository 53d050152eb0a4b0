// SPDX-License-Identifier: Apache-2.0
// Backward pass of projection: from the gradients of splats to those of the primitives' parameters.
#pragma once

#include <vector>

#include "backend/cpu/blend_backward.h"
#include "math/camera_grad.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/raster.h"

namespace stgs::encoder::cpu {

// Gradients of the parameters of the S visible primitives; entry s belongs to primitive
// frame.splats[s].id. Arrays are interleaved, entry by entry.
struct PrimitiveGradients {
  int sh_coefficients = 0;           // K, as evaluated
  std::vector<float> position;       // S x 3
  std::vector<float> log_scale;      // S x 3
  std::vector<float> rotation;       // S x 4, of the quaternion as stored
  std::vector<float> opacity_logit;  // S
  std::vector<float> sh;             // S x K x 3, coefficient then channel
  std::vector<float> time;           // S, through motion and visibility
  std::vector<float> velocity;       // S x 3, of the effective velocity u = v / f
  std::vector<float> sigma;          // S, through visibility only
  std::vector<float> radius;         // S, through visibility only
  // Gradient of the covariance (xx xy xz yy yz zz), equivalent to log_scale and rotation together.
  // Filled only if with_covariance is set.
  bool with_covariance = false;
  std::vector<math::Sym3> covariance;  // S
  // Gradient of the camera, through all splats. Computed only if with_camera is set.
  bool with_camera = false;
  math::CameraGrad camera{};

  void resize(std::size_t splats, int coefficients);
  std::size_t size() const { return opacity_logit.size(); }
};

// Computes the gradients of the set's parameters. `frame` must be the slice of `set` alone at t
// with these settings and id base 0; `splats` is the output of blend_backward() for it.
void project_backward(const Gaussians4D& set, float t, const math::PinholeCamera& camera,
                      const RasterSettings& settings, const SplatFrame& frame,
                      const std::vector<SplatGradients>& splats, PrimitiveGradients& out);

// Converts out.velocity from the gradient of u = v / f(sigma, r) to that of the learnt v. No
// gradient passes through f to sigma and r, because damped_velocity (math/damp.h) preserves u when
// they change.
void modulation_backward(const Gaussians4D& set, const SplatFrame& frame, PrimitiveGradients& out);

}  // namespace stgs::encoder::cpu
