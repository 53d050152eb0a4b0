// SPDX-License-Identifier: Apache-2.0
// The calibration of a capture as a file, for further captures of the same rig and for stgs live.
#pragma once

#include <string>
#include <vector>

#include "camera_plan.h"
#include "source_capture.h"

namespace stgs::encoder {

// Writes the calibration of the source frames, in the format of cameras.json (videos.cpp), to
// `path`, atomically. `plans` are those of the cameras, `fps` is the frame rate of the capture.
// kIo on failure; kInvalidFile if a name is not valid UTF-8.
Status write_rig(const SourceCapture& capture, const std::vector<CameraPlan>& plans, double fps,
                 const std::string& path);

}  // namespace stgs::encoder
