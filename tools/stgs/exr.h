// SPDX-License-Identifier: Apache-2.0
// EXR files; kNotBuilt in a build without OpenEXR.
#pragma once

#include <string>

#include "stgs/format/raster.h"
#include "stgs/format/status.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {

// Writes to `path`; messages call it `shown_path`.
Status write_exr_file(const std::string& path, const std::string& shown_path,
                      const player::Frame& frame);
// R, G, B as sRGB-encoded planes.
Result<Image> read_exr_file(const std::string& path);

}  // namespace stgs::tools
