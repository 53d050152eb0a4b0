// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "object.h"
#include "stgs/player/renderer.h"

namespace stgs::sdk {

// Checks that at least one buffer is requested and that all of them fit an image of this size.
Outcome check_image(const stgs_image& image, std::uint32_t width, std::uint32_t height);
// Fills the buffers, which have been checked for the size of the frame.
void write_image(const player::Frame& frame, const stgs_image& image);

}  // namespace stgs::sdk
