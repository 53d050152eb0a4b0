// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "object.h"
#include "stgs/player/renderer.h"

namespace stgs::sdk {

// The buffers of a picture of that size are large enough, and something is wanted.
Outcome check_picture(const stgs_image& picture, std::uint32_t width, std::uint32_t height);
// Fills the buffers, which have been checked for the frame's size.
void write_picture(const player::Frame& frame, const stgs_image& picture);

}  // namespace stgs::sdk
