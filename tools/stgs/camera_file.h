// SPDX-License-Identifier: Apache-2.0
// A camera as JSON: an entry of capture.json's "cameras", or "start_camera" of `stgs info`.
#pragma once

#include <string>

#include "options.h"
#include "session.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Reads a camera file, or the start camera from the output of `stgs info --format json`.
Result<encoder::Camera> read_camera(const std::string& path);
// Converts the start camera of `file`. kInvalidFile if its size, focal lengths or rotation are
// invalid.
Result<encoder::Camera> camera_of(const StartCamera& start, const std::string& file);
Json camera_json(const StartCamera& start);

// Returns the same view at another size: each axis of the intrinsics is scaled on its own.
encoder::Camera resized(encoder::Camera camera, Size size);

// Selects cameras of a prepared capture: "test", "train", "all", or comma-separated names.
Result<std::vector<encoder::Camera>> choose_cameras(const encoder::PreparedCapture& capture,
                                                    const std::string& which);

}  // namespace stgs::tools
