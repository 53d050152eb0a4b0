// SPDX-License-Identifier: Apache-2.0
// A camera path around a scene that stays where the rig has seen it.
#pragma once

#include <vector>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::tools {

// Returns `count` views of a closed path that looks at the centre of the scene: a whole turn if the
// training cameras stand all around it, otherwise to and fro between the outermost ones. Height and
// distance follow the cameras nearby. The size and the intrinsics are those of the first training
// camera. The capture has at least one.
std::vector<encoder::Camera> turntable(const encoder::PreparedCapture& capture, int count);

}  // namespace stgs::tools
