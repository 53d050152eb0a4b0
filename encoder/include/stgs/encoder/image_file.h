// SPDX-License-Identifier: Apache-2.0
// Reads 8-bit PNG and JPEG images without OpenCV.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/byte_source.h"

namespace stgs::encoder {

inline constexpr std::uint64_t kNoMemoryLimit = std::numeric_limits<std::uint64_t>::max();
// The largest number of pixels that an image may have.
inline constexpr std::int64_t kMaxImagePixels = std::int64_t{1} << 28;

// Validates the size that an image header states, before any allocation. kInvalidFile if a side is
// not 1 to kMaxImageSide pixels; kUnsupported for more than kMaxImagePixels.
Status check_image_size(std::int64_t width, std::int64_t height, const std::string& path);

// Returns true for a JPEG without an end-of-image marker. The file was cut short, or its writer
// omitted the marker; decoders would return a partly grey image. Bytes after the marker are valid.
bool is_truncated_jpeg(std::span<const std::uint8_t> bytes);

// Checks that a JPEG file states one size, of at most 4096 pixels for each byte, has at most 200
// scans, and has valid Huffman tables; kInvalidFile otherwise. Success for other files.
Status check_jpeg(std::span<const std::uint8_t> bytes, const std::string& path);

// Returns whether a marker begins the header of a JPEG image, which states its size.
bool is_jpeg_frame_header(std::uint8_t marker);

// Returns whether all JPEG headers in a stored frame of a video together state more pixels than
// check_jpeg() allows for its bytes. Decoders accept headers at any position, and allocate and
// clear an image for each.
bool has_oversized_jpeg(std::span<const std::uint8_t> frame);

// Decodes a PNG or JPEG file to `channels` (1 or 3) channels. The header is checked with
// check_image_size before decoding. kInvalidFile for an undecodable or truncated image.
// kUnsupported if the file and its pixels take more than `max_memory` bytes.
Result<Image8> read_image8(const std::string& path, int channels,
                           std::uint64_t max_memory = kNoMemoryLimit);
Result<Image8> read_image8(const ByteSource& file, int channels,
                           std::uint64_t max_memory = kNoMemoryLimit);
// As read_image8() for the bytes of a file. `path` is for messages.
Result<Image8> decode_image8(const std::vector<std::uint8_t>& bytes, int channels,
                             const std::string& path, std::uint64_t max_memory = kNoMemoryLimit);

}  // namespace stgs::encoder
