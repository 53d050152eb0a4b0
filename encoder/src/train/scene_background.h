// SPDX-License-Identifier: Apache-2.0
// What is shown where a scene has nothing.
#pragma once

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {

// The colour that the training cameras' middle frames have where the scene at its start lets light
// through: the median of each channel, weighted with the transmittance; sRGB-encoded in [0,1].
// Behind a scene, it makes what no camera saw look like the rest instead of black, and spares the
// training from painting what shines through with primitives that one camera alone sees.
Result<math::Vec3> scene_background(const PreparedCapture& capture, const Gaussians4D& start);

}  // namespace stgs::encoder
