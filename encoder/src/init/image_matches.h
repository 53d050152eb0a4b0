// SPDX-License-Identifier: Apache-2.0
// Points that two views both see, found without their calibration.
#pragma once

#include <opencv2/core.hpp>
#include <set>
#include <vector>

#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Matches of two views, indices of the views and image positions in pixels (centres at +0.5).
struct PairMatches {
  int a = 0, b = 0;
  std::vector<cv::Point2d> in_a, in_b;
};

// Returns the frames in which matches are found: the first, the middle and the last.
std::set<int> matched_frames(const PreparedCapture& capture);

// Finds the matches of the first, the middle and the last frame between views that are likely to
// see the same: those with the most similar lines of sight, and those next to each other in the
// list, because the poses may be wrong. Keeps the matches that agree with one fundamental matrix,
// and pairs with enough of them.
Status find_matches(const PreparedCapture& capture, const std::vector<View>& views, Work& work,
                    std::vector<PairMatches>* out);

}  // namespace stgs::encoder::init
