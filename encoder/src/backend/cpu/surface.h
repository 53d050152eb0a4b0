// SPDX-License-Identifier: Apache-2.0
// The primitives' planes (math/surface.h) in a view, for L_n: forward and backward passes.
#pragma once

#include <vector>

#include "backend/cpu/project_backward.h"
#include "stgs/format/math/surface.h"

namespace stgs::encoder::cpu {

// Computes the planes; planes[s] belongs to frame.splats[s]. `frame` must be the slice of `set`
// alone at t with id base 0.
void find_planes(const Gaussians4D& set, float t, const math::PinholeCamera& camera,
                 const SplatFrame& frame, std::vector<math::Plane>& planes);

// Blends the planes like colours: normals to output.colour, distances to output.depth (hence
// divided by alpha). Restores the frame and the planes before returning.
void blend_planes(const RasterSettings& settings, SplatFrame& frame,
                  std::vector<math::Plane>& planes, RasterOutput& output);

// Adds the gradients through the planes (d_planes) to position, rotation, velocity (of u) and time.
void planes_backward(const Gaussians4D& set, float t, const math::PinholeCamera& camera,
                     const SplatFrame& frame, const std::vector<math::Plane>& d_planes,
                     PrimitiveGradients& out);

}  // namespace stgs::encoder::cpu
