// SPDX-License-Identifier: Apache-2.0
// Compares the calibration of a capture with matches between its images: finds wrong conventions of
// all cameras, and single cameras that disagree with the others.
#pragma once

#include <string>
#include <vector>

#include "init/image_matches.h"
#include "init/view.h"

namespace stgs::encoder::init {

// A mistake that explains why matches do not agree with a calibration.
struct Cause {
  std::string text;  // empty: none is known
  std::string remedy;
  double error = 0;  // without the mistake, pixels
};

// A camera that disagrees with the others.
struct Outlier {
  int view = 0;
  double error = 0;        // median distance of its matches from their epipolar lines, pixels
  bool is_behind = false;  // most of its matches are behind a camera
  Cause cause;
};

struct CalibrationCheck {
  std::size_t pairs = 0;  // of views with matches; below kMinPairs nothing was checked
  double error = 0;  // median over the pairs that do not stand out, pixels at the size of the views
  bool fits = true;  // most cameras agree
  bool is_behind = false;  // most matches are behind a camera
  Cause cause;             // of all cameras, if the calibration does not fit
  std::vector<Outlier> outliers;

  bool is_outlier(int view) const;
};

inline constexpr std::size_t kMinPairs = 3;

CalibrationCheck check_calibration(const std::vector<View>& views,
                                   const std::vector<PairMatches>& pairs);

// Describes the result for a report.
std::string text_of(const CalibrationCheck& check, const std::vector<View>& views);

// Checks the calibration by the images of some frames, in a stage of `work`, and logs the result
// and a warning for each outlier. Returns kInvalidFile if a known mistake explains a disagreement,
// with the mistake, its cameras unless it is that of all, and `name`, the name of the capture;
// `out` is then the result, too.
Status check_cameras(const PreparedCapture& capture, const std::vector<View>& views,
                     const std::string& name, Work& work, CalibrationCheck* out);

}  // namespace stgs::encoder::init
