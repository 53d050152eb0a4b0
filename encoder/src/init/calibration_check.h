// SPDX-License-Identifier: Apache-2.0
// Compares the calibration of a capture with matches between its images: finds wrong conventions of
// all cameras, and single cameras that disagree with the others.
#pragma once

#include <string>
#include <vector>

#include "init/image_matches.h"
#include "init/view.h"

namespace stgs::encoder::init {

// A camera that disagrees with the others.
struct Outlier {
  int view = 0;
  double error = 0;   // median distance of its matches from their epipolar lines, pixels
  std::string cause;  // the likely mistake, which explains the distance; empty: none is known
};

struct CalibrationCheck {
  std::size_t pairs = 0;  // of views with matches; below kMinPairs nothing was checked
  double error = 0;       // median over the pairs without outliers, pixels at the size of the views
  bool fits = true;       // most cameras agree
  // If it does not fit: the likely mistake of all cameras, without which `corrected` is the error;
  // empty: none is known.
  std::string cause;
  double corrected = 0;
  std::vector<Outlier> outliers;
};

inline constexpr std::size_t kMinPairs = 3;

CalibrationCheck check_calibration(const std::vector<View>& views,
                                   const std::vector<PairMatches>& pairs);

// Describes the result for a report.
std::string text_of(const CalibrationCheck& check, const std::vector<View>& views);

// Checks the calibration by the images of some frames, in a stage of `work`, and logs the result
// and a warning for each outlier. Returns kInvalidFile if a known mistake explains a disagreement,
// with the mistake, the camera unless it is that of all, and `name`, the name of the capture.
Result<CalibrationCheck> check_cameras(const PreparedCapture& capture,
                                       const std::vector<View>& views, const std::string& name,
                                       Work& work);

}  // namespace stgs::encoder::init
