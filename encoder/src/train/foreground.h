// SPDX-License-Identifier: Apache-2.0
// Training on what the masks of a capture show: the rest of each image has a colour that differs
// from view to view, so that only the alpha of the foreground explains all images.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder {

// Returns the colour around the foreground in a view of the capture, RGB. `view`: its camera, then
// its frame.
std::array<std::uint8_t, 3> colour_behind(std::size_t view);
// The same in [0, 1].
math::Vec3 background_behind(std::size_t view);

// Removes static points that fewer than three quarters of the training cameras that have them in
// their image show within the mask, in the first, the middle and the last frame. kInvalidFile for a
// missing mask.
Status keep_foreground(const PreparedCapture& capture, std::vector<InitialPoint>& statics);

}  // namespace stgs::encoder
