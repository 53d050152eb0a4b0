// SPDX-License-Identifier: Apache-2.0
// 8-bit pictures from PNG and JPEG files, without OpenCV.
#pragma once

#include <string>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// Decodes to `channels` (1 or 3) channels.
Result<Image8> read_image8(const std::string& path, int channels);

}  // namespace stgs::encoder
