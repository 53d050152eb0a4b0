// SPDX-License-Identifier: Apache-2.0
// Recognises images and videos by their first bytes.
//
// A decoder is chosen by the content of a file, so a name with an allowed extension alone could
// start any of them: FFmpeg alone has hundreds, and some of them (ffconcat, HLS, DASH) are scripts
// that name other files. Only the kinds of this file are handed to OpenCV.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "stgs/format/status.h"

namespace stgs::encoder {

// Returns kInvalidFile unless the content of an image is of the kind of its extension (PNG, JPEG,
// BMP, TIFF, WebP) and its header states a size that check_image_size() accepts. `bytes` is the
// whole file, `what` describes the image in messages.
Status check_image_kind(std::span<const std::uint8_t> bytes, const std::string& path,
                        const std::string& what);

// Returns kInvalidFile unless a file begins as an MP4, MOV, Matroska, WebM or AVI video, such that
// no other demuxer of FFmpeg can take it for its own. `begin` is the first kVideoProbeBytes, or the
// whole file if it is shorter.
inline constexpr std::size_t kVideoProbeBytes = 4096;
Status check_video_kind(std::span<const std::uint8_t> begin, const std::string& path,
                        const std::string& what);
// Returns whether a file begins as an MP4 or MOV video.
bool begins_with_box(std::span<const std::uint8_t> begin);
// Returns whether a file begins with an EBML header of a document type that FFmpeg's own probe
// looks for in the same way.
bool begins_with_matroska(std::span<const std::uint8_t> begin);

}  // namespace stgs::encoder
