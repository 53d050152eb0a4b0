// SPDX-License-Identifier: Apache-2.0
// The camera at which playback of a trained scene starts.
#pragma once

#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/scene_file.h"

namespace stgs::encoder {

// Returns the camera nearest to the mean of all camera centres. `cameras` must not be empty.
StartCamera start_camera(const std::vector<Camera>& cameras);

}  // namespace stgs::encoder
