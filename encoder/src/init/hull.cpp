// SPDX-License-Identifier: Apache-2.0
#include "init/hull.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "geometry/hull_rule.h"
#include "geometry/ray_votes.h"

namespace stgs::encoder::init {
namespace {

constexpr std::size_t kBatch = 3;  // views between which points are removed
constexpr int kDepths = geometry::kHullDepths;

// Removes the points that more than `most` views see outside of the mask, if those are many.
void drop_outside(int most, geometry::RayVotes* votes, std::vector<std::uint32_t>* points) {
  std::size_t left = 0;
  for (std::size_t k = 0; k < points->size(); ++k) left += int(votes->outside[k]) <= most ? 1 : 0;
  if (left > points->size() / 2) return;
  std::size_t to = 0;
  for (std::size_t k = 0; k < points->size(); ++k) {
    if (int(votes->outside[k]) > most) continue;
    (*points)[to] = (*points)[k];
    votes->depths[to] = votes->depths[k];
    votes->inside[to] = votes->inside[k];
    votes->outside[to++] = votes->outside[k];
  }
  points->resize(left);
  votes->resize(left);
}

}  // namespace

Silhouette make_silhouette(const View& view, const cv::Mat& mask, const cv::Mat& depth) {
  cv::Mat hiding(view.size(), CV_32F, cv::Scalar(std::numeric_limits<float>::max()));
  if (!depth.empty()) depth.copyTo(hiding, depth > 0);
  cv::Mat(-hiding).copyTo(hiding, mask);
  return {view, hiding, cv::countNonZero(mask) > 0};
}

void find_outside(const std::vector<Silhouette>& silhouettes, const cv::Vec3d& origin,
                  const cv::Vec3d& ray, const std::vector<float>& depths, double nearest,
                  std::vector<std::uint8_t>* outside) {
  geometry::RayVotes votes(depths);
  outside->assign(depths.size(), 1);
  std::vector<std::uint32_t> points(depths.size());  // that the votes are about
  std::iota(points.begin(), points.end(), 0u);
  const int views = int(silhouettes.size()), most = geometry::misses_allowed(views);
  for (std::size_t i = 0; i < silhouettes.size(); ++i) {
    if (i % kBatch == kBatch - 1) drop_outside(most, &votes, &points);
    if (points.empty()) return;
    const View& view = silhouettes[i].view;
    geometry::VotingView voting{silhouettes[i].hiding.ptr<float>(),
                                view.width,
                                view.height,
                                float(view.fx),
                                float(view.fy),
                                float(view.cx),
                                float(view.cy),
                                {},
                                {}};
    const cv::Vec3d start = view.to_camera(origin), along = view.rotation * ray;
    for (int k = 0; k < 3; ++k) {
      voting.start[k] = float(start[k]);
      voting.along[k] = float(along[k]);
    }
    geometry::add_votes(voting, float(nearest), &votes);
  }
  for (std::size_t k = 0; k < points.size(); ++k) {
    const int inside = int(votes.inside[k]), misses = int(votes.outside[k]);
    (*outside)[points[k]] = geometry::is_in_hull(inside, misses, views) ? 0 : 1;
  }
}

std::optional<DepthInterval> hull_depths(const std::vector<Silhouette>& silhouettes,
                                         const View& view, const cv::Mat& mask, const cv::Rect& box,
                                         const DepthInterval& limits) {
  std::vector<float> depths;
  const double step = (1 / limits.nearest - 1 / limits.farthest) / (kDepths - 1);
  const auto depth_at = [&](int k) { return 1 / (1 / limits.farthest + k * step); };
  for (int k = 0; k < kDepths; ++k) depths.push_back(float(depth_at(k)));
  const int stride = geometry::hull_stride(cv::countNonZero(mask(box)));
  int first = kDepths, last = -1;
  std::vector<std::uint8_t> outside;
  for (int y = box.y + stride / 2; y < box.br().y; y += stride) {
    for (int x = box.x + stride / 2; x < box.br().x; x += stride) {
      if (mask.at<std::uint8_t>(y, x) == 0) continue;
      find_outside(silhouettes, view.centre, view.ray(x + 0.5, y + 0.5), depths, limits.nearest,
                   &outside);
      for (int k = 0; k < kDepths; ++k) {
        if (outside[k] != 0) continue;
        first = std::min(first, k);
        last = std::max(last, k);
      }
    }
  }
  if (last < 0) return std::nullopt;
  return DepthInterval{depth_at(std::min(last + 1, kDepths - 1)), depth_at(std::max(first - 1, 0))};
}

}  // namespace stgs::encoder::init
