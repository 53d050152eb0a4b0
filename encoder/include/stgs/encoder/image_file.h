// SPDX-License-Identifier: Apache-2.0
// 8-bit pictures from PNG and JPEG files, without OpenCV.
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// At most this many pixels are read from a picture.
inline constexpr std::int64_t kMaxPicturePixels = std::int64_t{1} << 28;

// Whether a picture's stated size is one to make room for: kInvalidFile where a side is not 1 to
// kMaxPictureSide, kUnsupported above kMaxPicturePixels.
Status check_picture_size(std::int64_t width, std::int64_t height, const std::string& path);

// Decodes to `channels` (1 or 3) channels. The stated size is looked at before anything is decoded.
Result<Image8> read_image8(const std::string& path, int channels);

}  // namespace stgs::encoder
