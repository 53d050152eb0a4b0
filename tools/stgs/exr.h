// SPDX-License-Identifier: Apache-2.0
// OpenEXR files. All functions return kNotBuilt in a build without OpenEXR.
#pragma once

#include <string>

#include "image_io.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Writes to `path`. Messages name `display_path` instead.
Status write_exr_file(const std::string& path, const std::string& display_path,
                      const FloatFrame& frame);
// Reads R, G and B as sRGB-encoded planes.
Result<Image> read_exr_file(const std::string& path);

}  // namespace stgs::tools
