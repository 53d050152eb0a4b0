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

// Reads one camera; also takes the whole document that `stgs info --format json` prints.
Result<encoder::Camera> read_camera(const std::string& path);
// The start camera of `file`; kInvalidFile where its size, focal lengths or rotation make no sense.
Result<encoder::Camera> camera_of(const StartCamera& start, const std::string& file);
Json camera_json(const StartCamera& start);

// The same view at another size: the intrinsics are rescaled, an axis each.
encoder::Camera resized(encoder::Camera camera, Size size);

// The cameras of a prepared capture that `which` names: "test", "train", "all", or names with
// commas between.
Result<std::vector<encoder::Camera>> choose_cameras(const encoder::PreparedCapture& capture,
                                                    const std::string& which);

}  // namespace stgs::tools
