// SPDX-License-Identifier: Apache-2.0
// Image input and output: PNG and JPEG through stb, EXR through OpenEXR if it is built in.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// A rendered frame as floats; channels as in RasterOutput.
struct FloatFrame {
  Image colour, alpha, depth;
};

// Converts to interleaved 8-bit RGB: clamps to [0, 1] and rounds to nearest.
encoder::Image8 to_8bit(const Image& colour);
// Places two images side by side. If the heights differ, the right one is scaled (bilinear) to the
// height of the left one. kUnsupported if the result has more than encoder::kMaxImagePixels, kLimit
// if it needs more than `max_memory` bytes with its PNG file. `name`: of the right image, in
// messages.
Result<encoder::Image8> side_by_side(const encoder::Image8& left, const encoder::Image8& right,
                                     const std::string& name, std::uint64_t max_memory);

// Writes an 8-bit RGB PNG atomically.
Status write_png(const std::string& path, const encoder::Image8& image);
// The same for the only output of a run: first removes the leftovers of killed runs, and logs this.
Status write_single_png(const std::string& path, const encoder::Image8& image,
                        const encoder::LogSink& log);
// Writes R, G, B (linear light, sRGB primaries) and A as half floats, and Z (camera z in scene
// units, 0 where there is nothing) as float, atomically. kNotBuilt without OpenEXR.
Status write_exr(const std::string& path, const FloatFrame& frame);

// Reads a PNG, JPEG or EXR file, chosen by its extension, as planar sRGB-encoded RGB.
// kUnsupported if its file and its pixels take more than `max_memory` bytes.
Result<Image> read_image(const std::string& path, std::uint64_t max_memory);
// Returns whether read_image() accepts the extension of `path`.
bool is_image_name(const std::string& path);
// Returns the extension in lower case, with its dot.
std::string extension_of(const std::string& path);

}  // namespace stgs::tools
