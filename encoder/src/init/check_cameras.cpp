// SPDX-License-Identifier: Apache-2.0
// The messages of the calibration check.
#include "init/calibration_check.h"
#include "plural.h"

namespace stgs::encoder::init {
namespace {

// Returns how far matches are off.
std::string distance_text(double error, bool is_behind) {
  return is_behind ? "behind the cameras"
                   : fmt::format("{:.2g} pixels from their epipolar lines", error);
}

Status refusal(const std::string& name, const std::string& text, const Cause& cause) {
  return invalid_file(
      "{}: {}. Probable cause: {} (corrected: {:.2g} pixels); {}, or continue with "
      "--trust-calibration",
      name, text, cause.text, cause.error, cause.remedy);
}

// Logs a warning for each outlier; those with a known cause are the error.
Status report_outliers(const CalibrationCheck& check, const std::vector<View>& views,
                       const std::string& name, Work& work) {
  std::string refused;  // the cameras with the first cause
  Cause cause;
  for (const Outlier& outlier : check.outliers) {
    const std::string& camera = views[outlier.view].camera->name;
    work.log(fmt::format(
                 "calibration: camera '{}' disagrees with the others: its matches are {}; "
                 "check its pose and its intrinsics, leave it out, or train with --refine-cameras",
                 camera, distance_text(outlier.error, outlier.is_behind)),
             1);
    if (cause.text.empty()) cause = outlier.cause;
    if (cause.text.empty() || outlier.cause.text != cause.text) continue;
    refused += fmt::format("{}'{}'", refused.empty() ? "" : ", ", camera);
  }
  if (refused.empty()) return {};
  return refusal(name, "the calibration of " + refused + " does not fit the other cameras", cause);
}

}  // namespace

std::string text_of(const CalibrationCheck& check, const std::vector<View>& views) {
  if (check.pairs < kMinPairs) return "not checked: too few cameras have matches";
  std::string out = fmt::format("{}matches are {:.2g} pixels from their epipolar lines",
                                check.fits ? "" : "does not fit the images: ", check.error);
  for (const Outlier& outlier : check.outliers)
    out += fmt::format("; {}: {:.3g}", views[outlier.view].camera->name, outlier.error);
  return out;
}

Status check_cameras(const PreparedCapture& capture, const std::vector<View>& views,
                     const std::string& name, Work& work, CalibrationCheck* out) {
  *out = {};
  if (views.size() < kMinPairs) return {};  // they have too few pairs
  work.stage("calibration", 2 * static_cast<int>(matched_frames(capture).size()) + 1);
  std::vector<PairMatches> pairs;
  STGS_TRY(find_matches(capture, views, work, &pairs));
  *out = check_calibration(views, pairs);
  const CalibrationCheck& check = *out;
  if (check.pairs < kMinPairs) {
    work.log(fmt::format("calibration: not checked: {} of cameras have matches (expected {})",
                         plural(check.pairs, "pair"), kMinPairs),
             1);
    return {};
  }
  const std::string usual =
      fmt::format("matches between {} of cameras are {}", plural(check.pairs, "pair"),
                  distance_text(check.error, check.is_behind));
  if (!check.fits) {
    const std::string text = "the calibration does not fit the images: " + usual;
    if (!check.cause.text.empty()) return refusal(name, text, check.cause);
    work.log("calibration: " + text + "; check all cameras", 1);
    return {};
  }
  work.log("calibration: " + usual);
  return report_outliers(check, views, name, work);
}

}  // namespace stgs::encoder::init
