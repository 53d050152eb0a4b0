// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/capture_folder.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Checks a video before FFmpeg opens it: its kind (check_video_kind), and that its tables do not
// make FFmpeg allocate much more memory than the size of the file. `path` and `what` are for
// messages. Returns the bytes of the file without holes. Thread-safe.
Result<std::uint64_t> check_video_file(const CaptureFile& file, const std::string& path,
                                       const std::string& what);

}  // namespace stgs::encoder
