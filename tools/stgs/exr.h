// SPDX-License-Identifier: Apache-2.0
// OpenEXR files. All functions return kNotBuilt in a build without OpenEXR.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "image_io.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Returns the bytes of a file. `name`: of the file, in messages.
Result<std::vector<std::uint8_t>> encode_exr(const FloatFrame& frame, const std::string& name);
// Reads R, G and B of a regular file as sRGB-encoded planes.
// kUnsupported if its floats and its decoding need more than `max_memory` bytes, and for more than
// 64 channels; kRuntime after SIGINT or SIGTERM.
Result<Image> read_exr_file(const std::string& path, std::uint64_t max_memory);

}  // namespace stgs::tools
