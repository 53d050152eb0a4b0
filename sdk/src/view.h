// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "object.h"
#include "stgs/player/renderer.h"

namespace stgs::sdk {

stgs_view default_view();
// Checks that every member of the view is in its range.
Outcome check_view(const stgs_view& view);
player::View view_of(const stgs_view& view);
// Rotates a camera so that it is level and looks along the world's z axis, or along y if `up` is
// close to z. Does nothing if `up` is 0, 0, 0.
void align_up(const float (&up)[3], float (&rotation)[9]);

}  // namespace stgs::sdk
