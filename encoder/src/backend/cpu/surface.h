// SPDX-License-Identifier: Apache-2.0
// The primitives' planes (math/surface.h) in a view, for L_n: forward, and from their gradients to
// the primitives' parameters.
#pragma once

#include <vector>

#include "backend/cpu/project_backward.h"
#include "stgs/format/math/surface.h"

namespace stgs::encoder::cpu {

// planes[s] belongs to frame.splats[s]. `frame` is the slice of `set` alone at t with id base 0.
void find_planes(const Gaussians4D& set, float t, const math::PinholeCamera& camera,
                 const SplatFrame& frame, std::vector<math::Plane>& planes);

// Blends the planes as the colours are: normals in output.colour, distances in output.depth (hence
// divided by alpha). The frame and the planes are as before when it returns.
void blend_planes(const RasterSettings& settings, SplatFrame& frame,
                  std::vector<math::Plane>& planes, RasterOutput& output);

// Adds what goes through the planes, whose gradients are d_planes, to position, rotation, velocity
// (by u) and time.
void planes_backward(const Gaussians4D& set, float t, const math::PinholeCamera& camera,
                     const SplatFrame& frame, const std::vector<math::Plane>& d_planes,
                     PrimitiveGradients& out);

}  // namespace stgs::encoder::cpu
