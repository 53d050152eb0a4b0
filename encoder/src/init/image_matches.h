// SPDX-License-Identifier: Apache-2.0
// Points that two views both see, found without their calibration.
#pragma once

#include <opencv2/core.hpp>
#include <set>
#include <utility>
#include <vector>

#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Matches of two views, indices of the views and image positions in pixels (centres at +0.5).
struct PairMatches {
  int a = 0, b = 0;
  std::vector<cv::Point2d> in_a, in_b;
};

// Distinct points of an image: positions (centres at +0.5) and descriptors (SIFT).
struct Features {
  std::vector<cv::Point2d> points;
  cv::Mat descriptors;  // one row per point
};

// Finds at most `limit` features of an 8-bit RGB image, those of most contrast first. Returns only
// those where `mask` is not 0; an empty one is of the whole image.
Features find_features(const cv::Mat& image, std::size_t limit, const cv::Mat& mask = {});

// Returns the indices (in a, in b) of features that match clearly, in both directions.
std::vector<std::pair<int, int>> match_features(const Features& a, const Features& b);

// Returns the pairs of views that are likely to see the same, the smaller index first: those with
// the most similar lines of sight, and those next to each other in the list, because the poses may
// be wrong.
std::set<std::pair<int, int>> likely_pairs(const std::vector<View>& views);

// Returns the frames in which matches are found: the first, the last and, for pairs with few
// matches in these, the middle one. Fewer if they are the same.
std::vector<int> matched_frames(const PreparedCapture& capture);

// Finds the matches of the first and the last frame between likely_pairs(), and of the middle one
// if a pair has few in the first. Keeps the matches that agree with one fundamental matrix, and
// pairs with enough of them.
Status find_matches(const PreparedCapture& capture, const std::vector<View>& views, Work& work,
                    std::vector<PairMatches>* out);

}  // namespace stgs::encoder::init
