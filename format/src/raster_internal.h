// SPDX-License-Identifier: Apache-2.0
// The blend's kernels: the reference, and the machine's vector unit.
#pragma once

#include <string>

#include "stgs/format/raster_tiles.h"

namespace stgs::raster {

void blend_tile_scalar(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output);
void blend_tile_vector(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output);
std::string blend_vector_target();

}  // namespace stgs::raster
