// SPDX-License-Identifier: Apache-2.0
// Estimates the background of a scene.
#pragma once

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {

// Returns the median of each channel over the training cameras' middle frames, weighted with the
// transmittance of the scene `initial`; sRGB-encoded in [0,1]. `border_only`: only pixels near the
// borders of the images count, beyond which a sky continues.
//
// With this background, regions that no camera covered blend in instead of being black, and
// training need not paint the background with primitives that serve a single camera.
Result<math::Vec3> scene_background(const PreparedCapture& capture, const Gaussians4D& initial,
                                    int kernel, bool border_only);

}  // namespace stgs::encoder
