// SPDX-License-Identifier: Apache-2.0
#include "init/image_matches.h"

#include <algorithm>
#include <numeric>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <utility>

#include "geometry/nearest_rows.h"

namespace stgs::encoder::init {
namespace {

// Per view. With 1500, as many wrong poses are found in twice the time (workshop).
constexpr std::size_t kMaxFeatures = 600;
constexpr double kContrast = 0.015;      // least contrast of a feature; OpenCV: 0.04
constexpr int kPartners = 5;             // views by line of sight
constexpr float kRatio = 0.8f;           // of the distances of the best match and the second
constexpr double kFixed = 1;             // pixels: positions that differ by less are the same
constexpr double kInlier = 1.5;          // pixels from the line of a match
constexpr std::size_t kMinMatches = 16;  // of a pair
constexpr std::size_t kEnough = 80;      // of a pair: the middle frame is not needed
constexpr double kMinInlierShare = 0.3;

bool is_clear(const geometry::NearestRow& nearest) {
  return nearest.index >= 0 && nearest.first < kRatio * kRatio * nearest.second;
}

geometry::Rows rows_of(const cv::Mat& descriptors) {
  return {descriptors.ptr<float>(), descriptors.rows, descriptors.cols};
}

// Returns whether a match is there already, from another frame.
bool contains(const PairMatches& pair, const cv::Point2d& p, const cv::Point2d& q) {
  for (std::size_t i = 0; i < pair.in_a.size(); ++i)
    if (cv::norm(pair.in_a[i] - p) < kFixed && cv::norm(pair.in_b[i] - q) < kFixed) return true;
  return false;
}

// Adds the matches of a frame.
void add_matches(const Features& a, const Features& b, PairMatches* out) {
  for (const auto& [i, j] : match_features(a, b)) {
    const cv::Point2d p = a.points[i], q = b.points[j];
    // Matches at one position may be texts in the images.
    if (cv::norm(p - q) < kFixed || contains(*out, p, q)) continue;
    out->in_a.push_back(p);
    out->in_b.push_back(q);
  }
}

// Keeps the matches that agree with one fundamental matrix; none if they are too few.
void keep_consistent(PairMatches* pair) {
  const std::vector<cv::Point2d> in_a = std::exchange(pair->in_a, {}),
                                 in_b = std::exchange(pair->in_b, {});
  if (in_a.size() < kMinMatches) return;
  std::vector<std::uint8_t> inlier;
  const cv::Mat matrix =
      cv::findFundamentalMat(in_a, in_b, cv::USAC_MAGSAC, kInlier, 0.999, 2000, inlier);
  if (matrix.empty()) return;
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    if (inlier[i] == 0) continue;
    pair->in_a.push_back(in_a[i]);
    pair->in_b.push_back(in_b[i]);
  }
  const auto share = static_cast<double>(pair->in_a.size()) / static_cast<double>(in_a.size());
  if (pair->in_a.size() < kMinMatches || share < kMinInlierShare) pair->in_a.clear();
}

}  // namespace

Features find_features(const cv::Mat& image, std::size_t limit, const cv::Mat& mask) {
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_RGB2GRAY);
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  cv::SIFT::create(int(limit), 3, kContrast)->detectAndCompute(grey, mask, points, descriptors);
  std::vector<int> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return points[a].response > points[b].response; });
  if (order.size() > limit) order.resize(limit);  // it keeps all of equal contrast
  Features out;
  for (const int i : order) {
    out.points.emplace_back(points[i].pt.x + 0.5, points[i].pt.y + 0.5);
    out.descriptors.push_back(descriptors.row(i));
  }
  return out;
}

std::vector<std::pair<int, int>> match_features(const Features& a, const Features& b) {
  std::vector<std::pair<int, int>> out;
  if (a.points.size() < 2 || b.points.size() < 2) return out;
  // Distances are exact: descriptors hold integers up to 255, and all sums are below 2^24.
  const geometry::NearestRows nearest =
      geometry::find_nearest_rows(rows_of(a.descriptors), rows_of(b.descriptors));
  for (int i = 0; i < a.descriptors.rows; ++i) {
    const geometry::NearestRow& best = nearest.to_b[i];
    if (!is_clear(best)) continue;
    const geometry::NearestRow& back = nearest.to_a[best.index];
    if (back.index == i && is_clear(back)) out.emplace_back(i, best.index);
  }
  return out;
}

std::set<std::pair<int, int>> likely_pairs(const std::vector<View>& views) {
  std::set<std::pair<int, int>> out;
  const int n = static_cast<int>(views.size());
  for (int i = 0; i < n; ++i) {
    std::vector<int> others;
    for (int k = 0; k < n; ++k)
      if (k != i) others.push_back(k);
    const auto distance = [&](int k) { return cv::norm(views[i].centre - views[k].centre); };
    double farthest = 1e-300;
    for (const int k : others) farthest = std::max(farthest, distance(k));
    // The difference of the lines of sight, and of the positions if the former are about equal.
    const auto difference = [&](int k) {
      return cv::norm(views[i].forward() - views[k].forward()) + 0.3 * distance(k) / farthest;
    };
    const int count = std::min(kPartners, n - 1);
    std::partial_sort(others.begin(), others.begin() + count, others.end(), [&](int a, int b) {
      return std::pair(difference(a), a) < std::pair(difference(b), b);
    });
    others.resize(count);
    if (n > 1) others.push_back((i + 1) % n);
    for (const int k : others) out.insert({std::min(i, k), std::max(i, k)});
  }
  return out;
}

std::vector<int> matched_frames(const PreparedCapture& capture) {
  std::vector<int> out{0};
  for (const int frame : {capture.frames - 1, capture.frames / 2})
    if (std::find(out.begin(), out.end(), frame) == out.end()) out.push_back(frame);
  return out;
}

Status find_matches(const PreparedCapture& capture, const std::vector<View>& views, Work& work,
                    std::vector<PairMatches>* out) {
  const std::vector<int> frames = matched_frames(capture);
  out->clear();
  for (const auto& [a, b] : likely_pairs(views)) out->push_back({a, b, {}, {}});
  std::vector<Features> features(views.size());
  // The last frame is always compared, because a camera may have been moved.
  const auto is_open = [&](const PairMatches& pair, int frame) {
    return frame == 0 || frame == capture.frames - 1 || pair.in_a.size() < kEnough;
  };
  for (const int frame : frames) {
    std::vector<bool> is_needed(views.size(), false);
    for (const PairMatches& pair : *out)
      if (is_open(pair, frame)) is_needed[pair.a] = is_needed[pair.b] = true;
    STGS_TRY(work.for_each(int(views.size()), [&](int i) -> Status {
      features[i] = {};
      if (!is_needed[i] || !has_frame(capture, *views[i].camera, frame)) return {};
      STGS_ASSIGN(const cv::Mat image, load_image(capture, views[i], frame));
      features[i] = find_features(image, kMaxFeatures);
      return {};
    }));
    STGS_TRY(work.for_each(int(out->size()), [&](int i) -> Status {
      PairMatches& pair = (*out)[i];
      if (is_open(pair, frame)) add_matches(features[pair.a], features[pair.b], &pair);
      return {};
    }));
  }
  STGS_TRY(work.for_each(int(out->size()), [&](int i) -> Status {
    keep_consistent(&(*out)[i]);
    return {};
  }));
  std::erase_if(*out, [](const PairMatches& pair) { return pair.in_a.empty(); });
  return {};
}

}  // namespace stgs::encoder::init
