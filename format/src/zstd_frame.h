// SPDX-License-Identifier: Apache-2.0
// The stored bytes of a stream as a Zstandard frame (spec 7.2): what may be one, looked at before
// the library sees it.
#pragma once

#include <cstdint>
#include <span>

namespace stgs {

// The most that a frame may need besides its content, of which it is a window.
inline constexpr std::uint64_t kMostWindow = std::uint64_t{8} << 20;
// zstd stores 128 KiB of one value in 4 bytes.
inline constexpr std::uint64_t kMostZstdExpansion = 32768;

// What keeps `stored` from being one frame of `size` bytes, as far as its header tells (RFC 8878,
// 3.1.1.1), or null. Allocates nothing.
const char* zstd_frame_problem(std::span<const std::uint8_t> stored, std::uint64_t size);

// Decodes such a frame, which must fill `out`; what is wrong, or null.
const char* zstd_unpack(std::span<const std::uint8_t> stored, std::span<std::uint8_t> out);

}  // namespace stgs
