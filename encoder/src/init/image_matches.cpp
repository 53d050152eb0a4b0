// SPDX-License-Identifier: Apache-2.0
#include "init/image_matches.h"

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <utility>

namespace stgs::encoder::init {
namespace {

constexpr std::size_t kMaxFeatures = 2000;  // per view
constexpr double kContrast = 0.015;         // least contrast of a feature; OpenCV: 0.04
constexpr int kPartners = 5;                // views by line of sight
constexpr float kRatio = 0.8f;              // of the distances of the best match and the second
constexpr double kFixed = 1;                // pixels: positions that differ by less are the same
constexpr double kInlier = 1.5;             // pixels from the line of a match
constexpr std::size_t kMinMatches = 16;     // of a pair
constexpr double kMinInlierShare = 0.3;

// Of a view in a frame.
struct Features {
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
};

Status detect(const PreparedCapture& capture, const View& view, int frame, Features* out) {
  STGS_ASSIGN(const cv::Mat image, load_image(capture, view, frame));
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_RGB2GRAY);
  const cv::Ptr<cv::SIFT> sift = cv::SIFT::create(int(kMaxFeatures), 3, kContrast);
  sift->detect(grey, out->points);
  // It keeps all of equal contrast.
  if (out->points.size() > kMaxFeatures) out->points.resize(kMaxFeatures);
  sift->compute(grey, out->points, out->descriptors);
  return {};
}

// Returns the pairs of views to match, the smaller index first.
std::set<std::pair<int, int>> pairs_of(const std::vector<View>& views) {
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

// Returns whether the best match of a feature is much better than the second one.
bool is_clear(const std::vector<cv::DMatch>& two) {
  return two[0].distance < kRatio * two[1].distance;
}

// Returns whether a match is there already, from another frame.
bool contains(const PairMatches& pair, const cv::Point2d& p, const cv::Point2d& q) {
  for (std::size_t i = 0; i < pair.in_a.size(); ++i)
    if (cv::norm(pair.in_a[i] - p) < kFixed && cv::norm(pair.in_b[i] - q) < kFixed) return true;
  return false;
}

// Adds the features that match clearly in a frame, in both directions.
void add_matches(const Features& a, const Features& b, PairMatches* out) {
  if (a.points.size() < 2 || b.points.size() < 2) return;
  const cv::BFMatcher matcher(cv::NORM_L2);
  std::vector<std::vector<cv::DMatch>> found, back;
  matcher.knnMatch(a.descriptors, b.descriptors, found, 2);
  std::erase_if(found, [](const auto& two) { return !is_clear(two); });
  cv::Mat candidates;  // the descriptors of the matches in b
  for (const auto& m : found) candidates.push_back(b.descriptors.row(m[0].trainIdx));
  if (candidates.empty()) return;
  matcher.knnMatch(candidates, a.descriptors, back, 2);
  const cv::Point2d centre(0.5, 0.5);
  for (std::size_t i = 0; i < found.size(); ++i) {
    const cv::DMatch& m = found[i][0];
    if (back[i][0].trainIdx != m.queryIdx || !is_clear(back[i])) continue;
    const cv::Point2d p = a.points[m.queryIdx].pt, q = b.points[m.trainIdx].pt;
    // Matches at one position may be texts in the images.
    if (cv::norm(p - q) < kFixed || contains(*out, p + centre, q + centre)) continue;
    out->in_a.push_back(p + centre);
    out->in_b.push_back(q + centre);
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

std::set<int> matched_frames(const PreparedCapture& capture) {
  return {0, capture.frames / 2, capture.frames - 1};
}

Status find_matches(const PreparedCapture& capture, const std::vector<View>& views, Work& work,
                    std::vector<PairMatches>* out) {
  const std::set<int> frames = matched_frames(capture);
  out->clear();
  for (const auto& [a, b] : pairs_of(views)) out->push_back({a, b, {}, {}});
  std::vector<Features> features(views.size());
  for (const int frame : frames) {
    STGS_TRY(work.for_each(int(views.size()),
                           [&](int i) { return detect(capture, views[i], frame, &features[i]); }));
    STGS_TRY(work.for_each(int(out->size()), [&](int i) -> Status {
      PairMatches& pair = (*out)[i];
      add_matches(features[pair.a], features[pair.b], &pair);
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
