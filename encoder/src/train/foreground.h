// SPDX-License-Identifier: Apache-2.0
// Training on the content inside the masks of a capture: the rest of each image has a colour that
// differs from view to view, so that only the right alpha explains all images.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {

// Returns the colour outside the mask of a view, RGB. `view`: index of the training camera, times
// the frames of the capture, plus the frame.
std::array<std::uint8_t, 3> mask_colour_of(std::size_t view);
// The same in [0, 1].
math::Vec3 mask_background_of(std::size_t view);

// Keeps the static points that lie inside the mask in at least three quarters of the images of
// training cameras that contain them, in the first, the middle and the last frame. kInvalidFile for
// a missing mask.
Status keep_foreground(const PreparedCapture& capture, std::vector<InitialPoint>& statics);

// Checks that all frames of the training cameras have masks; kInvalidFile names the first that has
// none.
Status check_masks(const PreparedCapture& capture);

}  // namespace stgs::encoder
