// SPDX-License-Identifier: Apache-2.0
// The CPU backend: the rasteriser of stgs/format/raster.h, applied to the active segments.
#pragma once

#include <memory>

#include "stgs/player/renderer.h"

namespace stgs::player {

std::unique_ptr<Renderer> make_cpu_renderer();

}  // namespace stgs::player
