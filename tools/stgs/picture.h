// SPDX-License-Identifier: Apache-2.0
// Pictures in and out: PNG and JPEG through stb, EXR through OpenEXR where it is built in.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {

// Colour to 8 bits a channel, interleaved RGB: clamped to [0,1], rounded to nearest.
encoder::Image8 to_8bit(const Image& colour);
// Two pictures of the same height side by side; the right one is scaled to fit (bilinear) where
// its height differs.
encoder::Image8 side_by_side(const encoder::Image8& left, const encoder::Image8& right);

// Writes an 8-bit RGB PNG, whole or not at all.
Status write_png(const std::string& path, const encoder::Image8& picture);
// Writes R, G, B (linear light, sRGB primaries) and A as half floats and Z (camera z, scene units,
// 0 where there is nothing) as float. kNotBuilt without OpenEXR.
Status write_exr(const std::string& path, const player::Frame& frame);

// Reads PNG, JPEG or EXR (by its ending) to planar sRGB-encoded RGB.
Result<Image> read_picture(const std::string& path);
bool is_picture_name(const std::string& path);
// The ending in lower case, with its dot.
std::string extension_of(const std::string& path);

}  // namespace stgs::tools
