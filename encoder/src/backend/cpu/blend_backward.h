// SPDX-License-Identifier: Apache-2.0
// From the gradient by the picture to the gradients by the splats of its frame.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/math/surface.h"
#include "stgs/format/raster.h"

namespace stgs::encoder::cpu {

// Gradients of the loss by one splat, and sums over the pixels u that it is drawn on, with its
// blending weights w(u). All are 0 for a splat that is drawn nowhere.
struct SplatGradients {
  math::Vec2 mean;      // dL/d pixel position
  math::Sym2 conic;     // by the named entries
  math::Vec3 colour;    //
  float opacity;        // by O_t
  math::Vec2 abs_mean;  // sum_u |dL/dmean.x|, |dL/dmean.y| (AbsGS)
  float error;          // sum_u w(u) Err(u): dL_e/de of the auxiliary loss
  float weight;         // sum_u w(u)
};

// Working memory, kept from call to call. Not shared between concurrent calls.
struct BlendBackwardScratch {
  std::vector<SplatGradients> instances;     // one entry an entry of frame.instances
  std::vector<math::Plane> plane_instances;  // the same, where planes are blended too
  std::vector<std::uint32_t> splat_begin, of_splat;
};

// A second picture that is blended with the same weights: the splats' planes (math/surface.h).
struct PlanesBackward {
  const std::vector<math::Plane>& planes;  // of frame.splats
  const Image& d_surface;                  // 4 planes, dL/d(blended normal x, y, z, distance)
  std::vector<math::Plane>& d_planes;      // filled with the gradients by `planes`
};

// `forward` is blend's output of this frame with these settings; d_colour has 3 planes dL/dcolour;
// error (1 plane) may be null, then SplatGradients::error is 0. out[s] belongs to frame.splats[s].
// The result does not depend on the number of threads. With `planes`, `out` holds what goes through
// both pictures.
void blend_backward(const SplatFrame& frame, const RasterSettings& settings,
                    const RasterOutput& forward, const Image& d_colour, const Image* error,
                    BlendBackwardScratch& scratch, std::vector<SplatGradients>& out,
                    const PlanesBackward* planes = nullptr);

}  // namespace stgs::encoder::cpu
