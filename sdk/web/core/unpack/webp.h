// SPDX-License-Identifier: Apache-2.0
// Decodes the bitstream of lossless WebP (RFC 9649, 3), for the import module, which has no
// libwebp. A browser's own decoder is not used: a canvas may change values, to protect privacy or
// with alpha.
#pragma once

#include <cstdint>
#include <span>

namespace stgs::web {

// Returns the memory that decode_vp8l() takes at most, bytes. `bytes`: of the stream.
std::uint64_t vp8l_scratch(std::uint64_t width, std::uint64_t height, std::uint64_t bytes);

// Decodes the stream behind its header of 5 bytes to pixels R G B A, 4 width height bytes. Returns
// false if it is damaged or truncated.
bool decode_vp8l(std::span<const std::uint8_t> stream, std::uint32_t width, std::uint32_t height,
                 std::span<std::uint8_t> rgba);

}  // namespace stgs::web
