// SPDX-License-Identifier: Apache-2.0
// The times of the cameras of a rig without synchronisation: timing.json in the capture folder,
// with any layout. It contains an object from names of cameras to objects with the optional keys
//   "time_offset"  seconds from time 0 of the capture to frame 0 of the camera; default 0
//   "fps"          frame rate of the camera; default: that of the capture
// Cameras that it does not contain have the defaults.
#pragma once

#include "source_capture.h"

namespace stgs::encoder {

inline constexpr const char* kTimingFile = "timing.json";

// Sets the times of the cameras, and capture.has_timing, if the capture has the file. kInvalidFile
// for unknown cameras and keys, and for values out of range.
Status attach_timing(SourceCapture& capture);

}  // namespace stgs::encoder
