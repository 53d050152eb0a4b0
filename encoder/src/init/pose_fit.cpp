// SPDX-License-Identifier: Apache-2.0
#include "init/pose_fit.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "init/epipolar.h"
#include "median.h"

namespace stgs::encoder::init {
namespace {

constexpr int kUnknowns = 7;  // rotation vector, translation, logarithm of the focal length
constexpr int kSteps = 30;
constexpr double kCauchy = 1;    // pixels
constexpr double kDelta = 1e-5;  // of the derivatives
using Unknowns = cv::Vec<double, kUnknowns>;
using Normal = cv::Matx<double, kUnknowns, kUnknowns>;

// `unit`: the length that the translation is measured in.
View changed(View view, const Unknowns& by, double unit) {
  cv::Matx33d turn;
  cv::Rodrigues(cv::Vec3d(by[0], by[1], by[2]), turn);
  view.rotation = turn * view.rotation;
  view.translation = turn * view.translation + unit * cv::Vec3d(by[3], by[4], by[5]);
  view.centre = -(view.rotation.t() * view.translation);
  view.fx *= std::exp(by[6]);
  view.fy *= std::exp(by[6]);
  return view;
}

// Signed distances of all matches.
std::vector<double> offsets_of(const std::vector<View>& views, const std::vector<PairMatches>& own,
                               int view, const View& candidate) {
  std::vector<double> out;
  for (const PairMatches& pair : own) {
    const View& a = pair.a == view ? candidate : views[pair.a];
    const View& b = pair.b == view ? candidate : views[pair.b];
    const cv::Matx33d f = fundamental_of(a, b);
    for (std::size_t i = 0; i < pair.in_a.size(); ++i)
      out.push_back(epipolar_offset(f, pair.in_a[i], pair.in_b[i]));
  }
  return out;
}

double loss_of(const std::vector<double>& offsets) {
  double sum = 0;
  for (const double d : offsets) sum += std::log1p(d * d / (kCauchy * kCauchy));
  return sum;
}

double median_size(std::vector<double> offsets) {
  for (double& d : offsets) d = std::abs(d);
  return median_value(std::move(offsets));
}

}  // namespace

double fitted_error(const std::vector<View>& views, const std::vector<PairMatches>& own, int view) {
  const View& given = views[view];
  double unit = 0;
  for (const PairMatches& pair : own)
    unit = std::max(unit, cv::norm(views[pair.a].centre - views[pair.b].centre));
  Unknowns best;
  std::vector<double> offsets = offsets_of(views, own, view, given);
  double damping = 1e-3;
  for (int step = 0; step < kSteps; ++step) {
    std::vector<std::vector<double>> slopes;
    for (int k = 0; k < kUnknowns; ++k) {
      Unknowns beside = best;
      beside[k] += kDelta;
      slopes.push_back(offsets_of(views, own, view, changed(given, beside, unit)));
    }
    Normal normal;
    Unknowns right;
    for (std::size_t i = 0; i < offsets.size(); ++i) {
      const double weight = 1 / (1 + offsets[i] * offsets[i] / (kCauchy * kCauchy));
      Unknowns row;
      for (int k = 0; k < kUnknowns; ++k) row[k] = (slopes[k][i] - offsets[i]) / kDelta;
      normal += weight * row * row.t();
      right -= weight * offsets[i] * row;
    }
    for (int k = 0; k < kUnknowns; ++k) normal(k, k) *= 1 + damping;
    for (int k = 0; k < kUnknowns; ++k) normal(k, k) += 1e-9;
    const Unknowns next = best + normal.solve(right, cv::DECOMP_SVD);
    std::vector<double> found = offsets_of(views, own, view, changed(given, next, unit));
    if (loss_of(found) < loss_of(offsets)) {
      best = next;
      offsets = std::move(found);
      damping = std::max(1e-9, 0.3 * damping);
    } else {
      damping *= 10;
    }
  }
  return median_size(std::move(offsets));
}

}  // namespace stgs::encoder::init
