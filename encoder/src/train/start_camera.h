// SPDX-License-Identifier: Apache-2.0
// Where playback of a trained scene starts.
#pragma once

#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/scene_file.h"

namespace stgs::encoder {

// The camera nearest to the middle of all of them; there must be one.
StartCamera start_camera(const std::vector<Camera>& cameras);

}  // namespace stgs::encoder
