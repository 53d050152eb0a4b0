// SPDX-License-Identifier: Apache-2.0
// The mp4 writer, which the module stgs_opencv.so contains.
#pragma once

#include "video.h"

namespace stgs::tools {

// As make_mp4_writer(), in a process that has loaded OpenCV.
Result<std::unique_ptr<VideoWriter>> open_mp4_writer(const std::string& path, TimeBase time_base,
                                                     const encoder::LogSink& log);

}  // namespace stgs::tools
