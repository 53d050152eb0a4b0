// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "object.h"
#include "stgs/player/renderer.h"

namespace stgs::sdk {

stgs_view default_view();
// Every number of the view is one that can be drawn with.
Outcome check_view(const stgs_view& view);
player::View view_of(const stgs_view& view);
// Turns a camera's axes so that it looks level: along the world's z, or its y where that is level
// and z is not. Leaves them where `up` is 0.
void stand_upright(const float (&up)[3], float (&rotation)[9]);

}  // namespace stgs::sdk
