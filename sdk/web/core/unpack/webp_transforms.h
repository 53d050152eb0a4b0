// SPDX-License-Identifier: Apache-2.0
// The transforms of lossless WebP (RFC 9649, 4). Pixels are A R G B from the highest byte.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace stgs::web {

// Returns the number of blocks of 2^bits pixels that cover `size` pixels.
inline std::uint32_t blocks_of(std::uint32_t size, int bits) {
  return (size + (1u << bits) - 1) >> bits;
}

// Returns the sum of each channel, modulo 256.
inline std::uint32_t add_channels(std::uint32_t a, std::uint32_t b) {
  return (((a & 0xFF00FF00u) + (b & 0xFF00FF00u)) & 0xFF00FF00u) |
         (((a & 0x00FF00FFu) + (b & 0x00FF00FFu)) & 0x00FF00FFu);
}

// Returns the value of the block with pixel (x, y).
using BlockValue = std::function<std::uint32_t(std::uint32_t x, std::uint32_t y)>;

// The functions below undo a transform of an image of width x height pixels, in place.
void undo_prediction(std::vector<std::uint32_t>& pixels, std::uint32_t width, std::uint32_t height,
                     const BlockValue& block);
void undo_cross_colour(std::vector<std::uint32_t>& pixels, std::uint32_t width,
                       std::uint32_t height, const BlockValue& block);
void undo_subtract_green(std::vector<std::uint32_t>& pixels);
// Replaces indices, of which each pixel holds 2^bits, by entries of a palette of 256.
void undo_palette(std::vector<std::uint32_t>& pixels, std::uint32_t width, std::uint32_t height,
                  int bits, std::span<const std::uint32_t> palette);

}  // namespace stgs::web
