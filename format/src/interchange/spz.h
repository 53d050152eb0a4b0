// SPDX-License-Identifier: Apache-2.0
// Constants of SPZ shared by reader and writer (layout: README.md of github.com/nianticlabs/spz).
//
// Each attribute is an array, primitive after primitive: positions in 24-bit fixed point, opacity,
// colour, log scale, rotation, SH. Versions 2 and 3 are one gzip stream of a 16-byte header and the
// arrays. Version 4 is a plain header of 32 bytes, a table of contents, and a zstd frame for each
// non-empty array. Axes: x right, y up, z back (RUB).
#pragma once

#include <array>
#include <cstdint>

namespace stgs::spz {

inline constexpr std::uint32_t kMagic = 0x5053474E;                          // "NGSP"
inline constexpr std::size_t kOldHeader = 16, kHeader = 32, kTocEntry = 16;  // bytes
inline constexpr std::uint8_t kAntialiased = 1, kHasExtensions = 2;          // flags
inline constexpr int kMaxDegree = 4;

enum Array { kPositions, kOpacities, kColours, kScales, kRotations, kSh, kArrays };

inline constexpr float kColourScale = 0.15f;  // colour = 0.15 c + 0.5, with the degree-0 SH c
inline constexpr float kHalfRoot = 0.70710678118654752f;  // bound of the three smallest components

inline constexpr int rest_coefficients(int degree) {
  return (degree + 1) * (degree + 1) - 1;
}

// Bytes per primitive of each array.
inline constexpr std::array<std::size_t, kArrays> strides(std::uint32_t version, int degree) {
  return {
      9, 1, 3, 3, version >= 3 ? 4u : 3u, 3 * static_cast<std::size_t>(rest_coefficients(degree))};
}

}  // namespace stgs::spz
