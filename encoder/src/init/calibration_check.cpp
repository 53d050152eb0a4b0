// SPDX-License-Identifier: Apache-2.0
#include "init/calibration_check.h"

#include <algorithm>
#include <cmath>

#include "init/epipolar.h"
#include "init/pose_fit.h"
#include "median.h"

namespace stgs::encoder::init {
namespace {

constexpr double kGood = 3;            // pixels: a pair with at most this error agrees roughly
constexpr double kPoor = 0.5;          // pixels: a pair with less is never poor
constexpr double kPoorRatio = 4;       // of the error of a poor pair and that of the better pairs
constexpr double kBadShare = 0.3;      // of the pairs agree roughly: the calibration does not fit
constexpr double kOutlierShare = 0.4;  // of the cameras: they are not a few among others
constexpr double kInFrontShare = 0.7;
constexpr double kMinAngle = 0.02;  // between the rays of a match, radians: its depth is known
constexpr int kMinKnown = 8;        // matches of known depth
// A mistake explains a disagreement if this share of at least so many pairs agree without it, with
// so small an error, and a given error that is large or matches behind the cameras.
constexpr double kExplainedShare = 0.7, kExplainedError = 1, kLargeError = 5;
// A camera whose error is smaller, or that agrees with one of the others, is an outlier only if a
// known mistake explains its matches, or if another pose and focal length reduce the error to this
// share. If none does, its matches connect similar objects. If the calibration is correct, more
// than 0.6 of the error remains.
constexpr double kFittedShare = 0.4;
constexpr std::size_t kMinPairsOfFit = 2;  // another pose explains the matches of any single pair
constexpr std::size_t kMinPairsOfSmallError = 3;
constexpr std::size_t kMinPairsOfAll = 6, kMinPairsOfOne = 3;

View with_pose(View view, const cv::Matx33d& rotation, const cv::Vec3d& translation) {
  view.rotation = rotation;
  view.translation = translation;
  view.centre = -(rotation.t() * translation);
  return view;
}

View inverted(const View& v) {
  return with_pose(v, v.rotation.t(), -(v.rotation.t() * v.translation));
}
View flipped(const View& v) {
  const cv::Matx33d flip(1, 0, 0, 0, -1, 0, 0, 0, -1);
  return with_pose(v, flip * v.rotation, flip * v.translation);
}
View flipped_and_inverted(const View& v) {
  return flipped(inverted(v));
}
View inverted_and_flipped(const View& v) {
  return inverted(flipped(v));
}
View transposed(const View& v) {
  return with_pose(v, v.rotation.t(), v.translation);
}
View with_scale(View v, double scale) {
  v.fx *= scale, v.fy *= scale, v.cx *= scale, v.cy *= scale;
  return v;
}
View doubled(const View& v) {
  return with_scale(v, 2);
}
View halved(const View& v) {
  return with_scale(v, 0.5);
}
View with_distance(const View& v, double scale) {
  return with_pose(v, v.rotation, scale * v.translation);
}
View from_mm(const View& v) {
  return with_distance(v, 0.001);
}
View to_mm(const View& v) {
  return with_distance(v, 1000);
}
View from_cm(const View& v) {
  return with_distance(v, 0.01);
}
View to_cm(const View& v) {
  return with_distance(v, 100);
}

// A mistake, its remedy, and the view without it.
struct Mistake {
  const char* text;
  const char* remedy;
  View (*corrected)(const View&);
};

constexpr Mistake kMistakes[] = {
    {"the poses are inverted (camera-to-world for world-to-camera)", "invert their matrices",
     inverted},
    {"the cameras have OpenGL's axes (y up, z backwards)",
     "negate the second and the third row of their world-to-camera matrices", flipped},
    {"the poses are camera-to-world, with OpenGL's axes (y up, z backwards)",
     "invert their matrices, then negate the second and the third row", flipped_and_inverted},
    {"the poses are inverted, and the cameras have OpenGL's axes (y up, z backwards)",
     "negate the second and the third row of their matrices, then invert them",
     inverted_and_flipped},
    {"the rotations are transposed", "transpose them", transposed},
    {"the intrinsics are those of images of half the size", "multiply them by 2", doubled},
    {"the intrinsics are those of images of twice the size", "divide them by 2", halved},
};
// Of a single camera among others.
constexpr Mistake kUnits[] = {
    {"the position is in mm, those of the others in m", "divide it by 1000", from_mm},
    {"the position is in m, those of the others in mm", "multiply it by 1000", to_mm},
    {"the position is in cm, those of the others in m", "divide it by 100", from_cm},
    {"the position is in m, those of the others in cm", "multiply it by 100", to_cm},
};

// Returns false if most matches have a known depth, and many of them are behind a camera.
bool is_in_front(const View& a, const View& b, const PairMatches& pair) {
  int known = 0, in_front = 0;
  const cv::Vec3d base = b.centre - a.centre;
  for (std::size_t i = 0; i < pair.in_a.size(); ++i) {
    const cv::Vec3d u = cv::normalize(a.ray(pair.in_a[i].x, pair.in_a[i].y));
    const cv::Vec3d v = cv::normalize(b.ray(pair.in_b[i].x, pair.in_b[i].y));
    const double cosine = u.dot(v), square = 1 - cosine * cosine;
    if (square < kMinAngle * kMinAngle) continue;
    // The points of both rays that are nearest to each other.
    const double along_a = (base.dot(u) - cosine * base.dot(v)) / square;
    const double along_b = (cosine * base.dot(u) - base.dot(v)) / square;
    ++known;
    in_front += along_a > 0 && along_b > 0 ? 1 : 0;
  }
  const bool is_known =
      known >= kMinKnown && 2 * static_cast<std::size_t>(known) >= pair.in_a.size();
  return !is_known || in_front >= kInFrontShare * known;
}

// Appends the distance of each match from its epipolar lines.
void append_distances(const View& a, const View& b, const PairMatches& pair,
                      std::vector<double>* out) {
  const cv::Matx33d f = fundamental_of(a, b);
  for (std::size_t i = 0; i < pair.in_a.size(); ++i)
    out->push_back(epipolar_distance(f, pair.in_a[i], pair.in_b[i]));
}

// How the matches of a pair agree with its calibration.
struct Agreement {
  double error = 0;  // median distance from the epipolar lines, pixels
  bool is_in_front = true;
  bool is_good() const { return is_in_front && error <= kGood; }
};

Agreement agreement_of(const View& a, const View& b, const PairMatches& pair) {
  std::vector<double> distances;
  append_distances(a, b, pair, &distances);
  return {median_value(std::move(distances)), is_in_front(a, b, pair)};
}

using Pairs = std::vector<PairMatches>;

// Returns the median distance of all matches of the pairs, of which there is at least one.
double median_distance(const std::vector<View>& views, const Pairs& pairs) {
  std::vector<double> distances;
  for (const PairMatches& pair : pairs)
    append_distances(views[pair.a], views[pair.b], pair, &distances);
  return median_value(std::move(distances));
}

std::vector<Agreement> agreements_of(const std::vector<View>& views, const Pairs& pairs) {
  std::vector<Agreement> out;
  for (const PairMatches& pair : pairs)
    out.push_back(agreement_of(views[pair.a], views[pair.b], pair));
  return out;
}

double median_error(const std::vector<Agreement>& agreements) {
  std::vector<double> errors;
  for (const Agreement& one : agreements) errors.push_back(one.error);
  return median_value(std::move(errors));
}

double share_of_good(const std::vector<Agreement>& agreements) {
  const auto good = std::count_if(agreements.begin(), agreements.end(),
                                  [](const Agreement& one) { return one.is_good(); });
  return static_cast<double>(good) /
         static_cast<double>(std::max<std::size_t>(agreements.size(), 1));
}

double share_in_front(const std::vector<Agreement>& agreements) {
  const auto count = std::count_if(agreements.begin(), agreements.end(),
                                   [](const Agreement& one) { return one.is_in_front; });
  return static_cast<double>(count) /
         static_cast<double>(std::max<std::size_t>(agreements.size(), 1));
}

// The search for a mistake that explains why pairs do not agree.
class Explanation {
 public:
  Explanation(const Pairs& pairs, const std::vector<Agreement>& given)
      : pairs_(pairs),
        can_explain_(share_of_good(given) <= kBadShare &&
                     (median_error(given) >= kLargeError || share_in_front(given) < 0.5)) {}

  // Considers a mistake; `corrected`: the views without it.
  void consider(const Mistake& mistake, const std::vector<View>& corrected) {
    if (!can_explain_) return;
    const std::vector<Agreement> found = agreements_of(corrected, pairs_);
    const double share = share_of_good(found), error = median_error(found);
    if (share <= best_ || error > kExplainedError) return;
    best_ = share;
    cause_ = {mistake.text, mistake.remedy, error};
  }
  Cause cause() const { return cause_; }

 private:
  const Pairs& pairs_;
  const bool can_explain_;
  double best_ = kExplainedShare;
  Cause cause_;
};

Cause common_cause(const std::vector<View>& views, const Pairs& pairs,
                   const std::vector<Agreement>& given) {
  if (pairs.size() < kMinPairsOfAll) return {};
  Explanation explanation(pairs, given);
  for (const Mistake& mistake : kMistakes) {
    std::vector<View> corrected;
    for (const View& view : views) corrected.push_back(mistake.corrected(view));
    explanation.consider(mistake, corrected);
  }
  return explanation.cause();
}

// The pairs of a view with views that are no outliers.
struct Partners {
  double all = 0, poor = 0;
  // A view with one pair alone may be right.
  double poor_share() const { return all < 2 ? 0 : poor / all; }
};

// Returns the error above which a pair is poor.
double poor_limit(const std::vector<Agreement>& agreements) {
  std::vector<double> errors;
  for (const Agreement& one : agreements) errors.push_back(one.error);
  const auto quarter = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 4);
  std::nth_element(errors.begin(), quarter, errors.end());
  return std::max(kPoor, kPoorRatio * *quarter);
}

bool is_poor(const Agreement& agreement, double limit) {
  return agreement.error > limit || !agreement.is_in_front;
}

// Returns the views that disagree with most of the others: the worst first, then those that
// disagree with the rest.
std::vector<int> find_outliers(std::size_t views, const Pairs& pairs,
                               const std::vector<Agreement>& agreements, double limit) {
  std::vector<bool> is_outlier(views, false);
  std::vector<int> out;
  for (;;) {
    std::vector<Partners> partners(views);
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (is_outlier[pairs[i].a] || is_outlier[pairs[i].b]) continue;
      const bool poor = is_poor(agreements[i], limit);
      for (const int v : {pairs[i].a, pairs[i].b}) {
        partners[v].all += 1;
        partners[v].poor += poor ? 1 : 0;
      }
    }
    const auto worst =
        std::max_element(partners.begin(), partners.end(), [](const auto& a, const auto& b) {
          return std::pair(a.poor_share(), a.poor) < std::pair(b.poor_share(), b.poor);
        });
    if (worst == partners.end() || worst->poor_share() <= 0.5) return out;
    out.push_back(static_cast<int>(worst - partners.begin()));
    is_outlier[out.back()] = true;
  }
}

bool contains(const std::vector<int>& views, int view) {
  return std::find(views.begin(), views.end(), view) != views.end();
}

// Returns the pairs of a view with views that are no outliers.
Pairs pairs_of(const Pairs& pairs, const std::vector<int>& outliers, int view) {
  Pairs own;
  for (const PairMatches& pair : pairs) {
    const int other = pair.a == view ? pair.b : pair.a;
    if ((pair.a == view || pair.b == view) && !contains(outliers, other)) own.push_back(pair);
  }
  return own;
}

// Adds the views that agree with half of the others or more, although another pose explains their
// matches much better. The worst first.
void find_small_errors(const std::vector<View>& views, const Pairs& pairs, std::vector<int>* out) {
  for (;;) {
    int worst = -1;
    double least = kFittedShare;
    for (int view = 0; view < static_cast<int>(views.size()); ++view) {
      const Pairs own = pairs_of(pairs, *out, view);
      if (contains(*out, view) || own.size() < kMinPairsOfSmallError) continue;
      const double error = median_distance(views, own);
      if (error <= kPoor) continue;
      const double share = fitted_error(views, own, view) / error;
      if (share < least) least = share, worst = view;
    }
    if (worst < 0) return;
    out->push_back(worst);
  }
}

// Describes an outlier by its pairs.
Outlier describe(const std::vector<View>& views, const Pairs& own, int view) {
  const std::vector<Agreement> given = agreements_of(views, own);
  Outlier out;
  out.view = view;
  out.error = median_distance(views, own);
  out.is_behind = share_in_front(given) < 0.5;
  if (own.size() < kMinPairsOfOne) return out;
  Explanation explanation(own, given);
  std::vector<View> corrected = views;
  const auto consider = [&](const Mistake& mistake) {
    corrected[view] = mistake.corrected(views[view]);
    explanation.consider(mistake, corrected);
  };
  for (const Mistake& mistake : kMistakes) consider(mistake);
  for (const Mistake& mistake : kUnits) consider(mistake);
  out.cause = explanation.cause();
  return out;
}

// Returns whether the matches of an outlier can be those of a camera whose calibration is wrong.
bool is_plausible(const std::vector<View>& views, const Pairs& own, const Outlier& outlier,
                  double limit) {
  const std::vector<Agreement> agreements = agreements_of(views, own);
  const bool is_far = outlier.error >= kLargeError &&
                      std::all_of(agreements.begin(), agreements.end(),
                                  [limit](const Agreement& one) { return is_poor(one, limit); });
  return outlier.is_behind || !outlier.cause.text.empty() || is_far ||
         (own.size() >= kMinPairsOfFit &&
          fitted_error(views, own, outlier.view) < kFittedShare * outlier.error);
}

}  // namespace

bool CalibrationCheck::is_outlier(int view) const {
  return std::any_of(outliers.begin(), outliers.end(),
                     [view](const Outlier& one) { return one.view == view; });
}

CalibrationCheck check_calibration(const std::vector<View>& views, const Pairs& pairs) {
  CalibrationCheck out;
  out.pairs = pairs.size();
  if (out.pairs < kMinPairs) return out;
  const std::vector<Agreement> agreements = agreements_of(views, pairs);
  out.error = median_error(agreements);
  out.is_behind = share_in_front(agreements) < 0.5;
  const double limit = poor_limit(agreements);
  std::vector<int> suspects = find_outliers(views.size(), pairs, agreements, limit);
  find_small_errors(views, pairs, &suspects);
  std::vector<Outlier> found;
  std::vector<int> outliers;
  for (const int view : suspects) {
    const Pairs own = pairs_of(pairs, suspects, view);
    const Outlier outlier = describe(views, own, view);
    if (!is_plausible(views, own, outlier, limit)) continue;
    found.push_back(outlier);
    outliers.push_back(view);
  }
  out.fits =
      share_of_good(agreements) > kBadShare &&
      static_cast<double>(outliers.size()) <= kOutlierShare * static_cast<double>(views.size());
  if (!out.fits) {
    out.cause = common_cause(views, pairs, agreements);
    return out;
  }
  std::vector<Agreement> others;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!contains(suspects, pairs[i].a) && !contains(suspects, pairs[i].b))
      others.push_back(agreements[i]);
  }
  if (others.size() >= kMinPairs) out.error = median_error(others);
  out.outliers = std::move(found);
  return out;
}

}  // namespace stgs::encoder::init
