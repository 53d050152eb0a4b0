// SPDX-License-Identifier: Apache-2.0
// Cameras and captures that belong to a scene opened through the public interface of the library.
#pragma once

#include <string>

#include "camera_file.h"
#include "scene_file.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/stgs.h"

namespace stgs::tools {

// Returns the view of a camera, in single precision, with everything else as in `like`.
stgs_view view_of(const encoder::Camera& camera, const stgs_view& like);
// Converts the start camera of a file. kInvalidFile if its size, focal lengths or rotation are
// invalid.
Result<encoder::Camera> camera_of(const stgs_view& start, const std::string& file);
// Returns the frames of a capture that the scene shows: all, or those of its window. kUsage if the
// scene is a window of another capture.
Result<encoder::PreparedCapture> capture_of_scene(const encoder::PreparedCapture& capture,
                                                  const SceneFile& file);

}  // namespace stgs::tools
