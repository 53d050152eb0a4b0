// SPDX-License-Identifier: Apache-2.0
// Fits the pose of one camera to its matches with others.
#pragma once

#include <vector>

#include "init/image_matches.h"
#include "init/view.h"

namespace stgs::encoder::init {

// Returns the median distance of the matches of `view` from their epipolar lines, in pixels, after
// its rotation, its position and its focal length are fitted to them (Levenberg-Marquardt, Cauchy
// loss). `own`: the pairs of that view with other views, which stay as they are; at least one
// match.
double fitted_error(const std::vector<View>& views, const std::vector<PairMatches>& own, int view);

}  // namespace stgs::encoder::init
