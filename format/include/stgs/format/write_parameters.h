// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "stgs/format/parameter.h"

namespace stgs {

// The numbers of WriteSettings that callers choose, for tables of parameters.
inline constexpr Parameter kQuality = {"quality", 0, 100,
                                       "0 (smallest file) to 100 (closest to the trained scene)"};
inline constexpr Parameter kTiers = {
    "tiers",
    1,
    16,
    "Number of tiers: the primitives by importance, so that a player can start with the first "
    "tier. An automatic choice has 3 of similar size, or more, of increasing size, if many "
    "primitives are active at once",
    "",
    "an automatic choice"};

}  // namespace stgs
