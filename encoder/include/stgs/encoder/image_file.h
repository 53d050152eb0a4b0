// SPDX-License-Identifier: Apache-2.0
// 8-bit pictures from PNG and JPEG files, without OpenCV.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "stgs/encoder/prepared_capture.h"

namespace stgs::encoder {

// At most this many pixels are read from a picture.
inline constexpr std::int64_t kMaxImagePixels = std::int64_t{1} << 28;

// Whether a picture's stated size is one to make room for: kInvalidFile where a side is not 1 to
// kMaxImageSide, kUnsupported above kMaxImagePixels.
Status check_image_size(std::int64_t width, std::int64_t height, const std::string& path);

// Whether a file's bytes are those of a JPEG without an end-of-image marker: one that was cut
// short, of which decoders make a picture that is partly grey, or one whose writer left the marker
// out, which cannot be told apart. What follows the marker may be anything.
bool is_truncated_jpeg(std::span<const std::uint8_t> bytes);

// Decodes to `channels` (1 or 3) channels. The stated size is looked at before anything is decoded;
// kInvalidFile where it is no whole picture.
Result<Image8> read_image8(const std::string& path, int channels);

}  // namespace stgs::encoder
