// SPDX-License-Identifier: Apache-2.0
// Backward pass of blending: from the gradient of the image to the gradients of its splats.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/math/surface.h"
#include "stgs/format/raster.h"

namespace stgs::encoder::cpu {

// Gradients of the loss with respect to one splat, and sums over the pixels u that it contributes
// to, with its blend weights w(u). All are 0 for a splat that contributes nowhere.
struct SplatGradients {
  math::Vec2 mean;   // dL/d pixel position
  math::Sym2 conic;  // with respect to the named entries
  math::Vec3 colour;
  float opacity;        // dL/dO_s
  math::Vec2 abs_mean;  // sum_u |dL/dmean.x|, |dL/dmean.y| (AbsGS)
  float error;          // sum_u w(u) Err(u): dL_e/de of the auxiliary loss
  float weight;         // sum_u w(u)
};

// Working memory, reused between calls. Must not be shared by concurrent calls.
struct BlendBackwardScratch {
  std::vector<SplatGradients> instances;     // one entry per entry of frame.instances
  std::vector<math::Plane> plane_instances;  // the same, with planes
  std::vector<std::uint32_t> splat_begin, of_splat;
};

// A second image blended with the same weights: the splats' planes (math/surface.h).
struct PlanesBackward {
  const std::vector<math::Plane>& planes;  // of frame.splats
  const Image& d_surface;                  // 4 planes, dL/d(blended normal x, y, z, distance)
  std::vector<math::Plane>& d_planes;      // filled with the gradients of `planes`
};

// Computes the gradients of all splats; out[s] belongs to frame.splats[s]. The result does not
// depend on the number of threads.
// - `forward`: the output of blend() for this frame and these settings.
// - `d_colour`: 3 planes, dL/dcolour.
// - `error`: 1 plane, or null; SplatGradients::error is then 0.
// - `planes`: if set, `out` contains the gradients through both images.
void blend_backward(const SplatFrame& frame, const RasterSettings& settings,
                    const RasterOutput& forward, const Image& d_colour, const Image* error,
                    BlendBackwardScratch& scratch, std::vector<SplatGradients>& out,
                    const PlanesBackward* planes = nullptr);

}  // namespace stgs::encoder::cpu
