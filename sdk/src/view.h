// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "object.h"
#include "stgs/player/renderer.h"

namespace stgs::sdk {

stgs_view default_view();
// Every number of the view is one that can be drawn with.
Outcome check_view(const stgs_view& view);
player::View view_of(const stgs_view& view);

}  // namespace stgs::sdk
