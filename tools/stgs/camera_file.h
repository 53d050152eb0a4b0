// SPDX-License-Identifier: Apache-2.0
// A camera as JSON: an entry of capture.json's "cameras", or "start_camera" of `stgs info`.
#pragma once

#include <string>

#include "options.h"
#include "session.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/status.h"

namespace stgs {
struct StartCamera;
}

namespace stgs::tools {

// Reads a camera file ("-": standard input), or the start camera from the output of `stgs info
// --format json`.
Result<encoder::Camera> read_camera(const std::string& path);
// Returns a camera as read_camera() reads it.
Json camera_json(const encoder::Camera& camera);
// Converts the start camera of `file`. kInvalidFile if its size, focal lengths or rotation are
// invalid.
Result<encoder::Camera> camera_of(const StartCamera& start, const std::string& file);

// Returns the camera at another size with square pixels preserved, as stgs_view_resize: shows at
// least the original view, and more along one axis if the aspect ratio differs.
encoder::Camera fitted(encoder::Camera camera, Size size);
// Returns the camera at another size with the field of view of each axis preserved, as
// stgs_view_stretch: another aspect ratio stretches the image.
encoder::Camera resized(encoder::Camera camera, Size size);

// Selects cameras of a prepared capture: "test", "train", "all", or comma-separated names.
Result<std::vector<encoder::Camera>> choose_cameras(const encoder::PreparedCapture& capture,
                                                    const std::string& which);

}  // namespace stgs::tools
