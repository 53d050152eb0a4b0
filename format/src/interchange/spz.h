// SPDX-License-Identifier: Apache-2.0
// What SPZ's reader and writer share (the layout: README.md of github.com/nianticlabs/spz).
//
// Every attribute is an array of its own, primitive after primitive: positions in 24-bit fixed
// point, opacity, colour, log scale, rotation, harmonics. Versions 2 and 3 are one gzip stream of a
// 16-byte header and the arrays; version 4 is a plain header of 32 bytes, a table of contents, and
// a zstd frame for each array that is not empty. Axes: x right, y up, z back (RUB).
#pragma once

#include <array>
#include <cstdint>

namespace stgs::spz {

inline constexpr std::uint32_t kMagic = 0x5053474E;                          // "NGSP"
inline constexpr std::size_t kOldHeader = 16, kHeader = 32, kTocEntry = 16;  // bytes
inline constexpr std::uint8_t kAntialiased = 1, kHasExtensions = 2;          // flags
inline constexpr int kMaxDegree = 4;

enum Array { kPositions, kOpacities, kColours, kScales, kRotations, kHarmonics, kArrays };

inline constexpr float kColourScale = 0.15f;  // colour = 0.15 c + 0.5 for the degree-0 harmonic c
inline constexpr float kHalfRoot = 0.70710678118654752f;  // the largest of the smallest three

inline constexpr int rest_coefficients(int degree) {
  return (degree + 1) * (degree + 1) - 1;
}

// Bytes a primitive of each array.
inline constexpr std::array<std::size_t, kArrays> strides(std::uint32_t version, int degree) {
  return {
      9, 1, 3, 3, version >= 3 ? 4u : 3u, 3 * static_cast<std::size_t>(rest_coefficients(degree))};
}

}  // namespace stgs::spz
