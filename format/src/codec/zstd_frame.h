// SPDX-License-Identifier: Apache-2.0
// Streams stored as Zstandard frames (spec 7.2). Headers are checked before the library decodes.
#pragma once

#include <cstdint>
#include <span>

namespace stgs {

// Greatest window of a frame whose content is smaller, bytes.
inline constexpr std::uint64_t kMaxWindow = std::uint64_t{8} << 20;
// Greatest expansion: zstd stores 128 KiB of one value in 4 bytes.
inline constexpr std::uint64_t kMaxZstdExpansion = 32768;

// Checks the header (RFC 8878, 3.1.1.1) of `stored` as one frame of `size` bytes of content.
// Returns the problem, or null. Allocates nothing.
const char* zstd_frame_problem(std::span<const std::uint8_t> stored, std::uint64_t size);

// Decodes a frame accepted by zstd_frame_problem(); it must fill `out`. Returns the problem, or
// null.
const char* zstd_unpack(std::span<const std::uint8_t> stored, std::span<std::uint8_t> out);

}  // namespace stgs
