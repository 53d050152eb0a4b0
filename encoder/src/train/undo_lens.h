// SPDX-License-Identifier: Apache-2.0
// Training images without the residuals of their lens, so that they can be compared with renders of
// a pinhole, and the gradient of vignetting.
#pragma once

#include "math/lens.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {

inline bool is_pinhole(const math::Lens& lens) {
  return lens.distortion == 0 && lens.vignetting == 0;
}

// Computes the image that a pinhole would have taken, of the same size; RGB, 8 bits. Beyond the
// border of `image` its border continues.
void undo_lens(const Image8& image, const math::PinholeCamera& camera, const math::Lens& lens,
               Image8& out);

// Returns dL/dv of the vignetting, at v = 0, for an image of these colours and their gradients dL/d
// colour; planar, 3 channels. Brightening the render towards the corners has the same effect as
// darkening the training image there.
float vignetting_gradient(const math::PinholeCamera& camera, const Image& colour,
                          const Image& d_colour);

}  // namespace stgs::encoder
