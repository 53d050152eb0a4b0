// SPDX-License-Identifier: Apache-2.0
// The visual hull of a ball: its points, and the depths at which rays meet it.
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "ball_scene.h"
#include "catch.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;
using namespace stgs::testing;

namespace {

bool is_in_hull(const std::vector<Silhouette>& views, const cv::Vec3d& point, double nearest) {
  std::vector<std::uint8_t> outside;
  find_outside(views, point, {0, 0, 0}, {0.0f}, nearest, &outside);
  return outside[0] == 0;
}

enum class Relation { kNotVisible, kOutside, kInside };

// Where a view sees a point.
Relation relation_of(const Silhouette& silhouette, const cv::Vec3d& point, double nearest) {
  const Pixel pixel = project(silhouette.view, point);
  if (!pixel.inside || pixel.depth < nearest) return Relation::kNotVisible;
  const float hiding = silhouette.hiding.at<float>(pixel.y(), pixel.x());
  if (pixel.depth > std::abs(hiding)) return Relation::kNotVisible;
  return hiding < 0 ? Relation::kInside : Relation::kOutside;
}

// A view with patches of motion, of `side` pixels, and of unknown and of near static surface.
Silhouette patchy(int side, cv::RNG& random) {
  const View view = view_at(0);
  cv::Mat mask(view.size(), CV_8U, cv::Scalar(0)), depth(view.size(), CV_32F, cv::Scalar(5));
  for (int i = 0; i < 12; ++i) {
    const cv::Point p(random.uniform(0, view.width), random.uniform(0, view.height));
    const cv::Rect box =
        cv::Rect(p.x, p.y, i % 3 == 0 ? side : 60, 60) & cv::Rect({0, 0}, view.size());
    if (i % 3 == 0) mask(box).setTo(255);
    if (i % 3 == 1) depth(box).setTo(0);
    if (i % 3 == 2) depth(box).setTo(random.uniform(2.0, 6.0));
  }
  return make_silhouette(view, mask, depth);
}

}  // namespace

TEST_CASE("the hull of a ball contains it and little else") {
  const std::vector<Silhouette> views = silhouettes(GENERATE(0.0, 9.0));
  cv::RNG random(3);
  for (int k = 0; k < 200; ++k) {
    const cv::Vec3d away(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0),
                         random.uniform(-1.0, 1.0));
    const cv::Vec3d point = kMiddle + 1.5 * kBall * away;
    if (cv::norm(point - kMiddle) < 0.95 * kBall) CHECK(is_in_hull(views, point, 0.5));
    if (cv::norm(point - kMiddle) > 1.4 * kBall) CHECK_FALSE(is_in_hull(views, point, 0.5));
  }
}

TEST_CASE("rays meet the hull at the depths of the ball, in a part of the image alone") {
  const std::vector<Silhouette> views = silhouettes(9);
  const View& view = views[2].view;
  const cv::Mat mask = mask_in(view);
  const cv::Rect all({0, 0}, view.size());
  const double depth = view.to_camera(kMiddle)[2];
  const auto found = hull_depths(views, view, mask, all, {0.5, 12});
  REQUIRE(found);
  CHECK(found->nearest < depth - 0.95 * kBall);
  CHECK(found->nearest > depth - 1.5 * kBall);
  CHECK(found->farthest > depth + 0.95 * kBall);
  CHECK(found->farthest < depth + 1.6 * kBall);
  CHECK_FALSE(hull_depths(views, view, mask, all, {0.5, depth - 2 * kBall}));
  CHECK_FALSE(hull_depths(views, view, mask, {0, 0, 20, 20}, {0.5, 12}));
}

TEST_CASE("points of a ray get the votes of single points") {
  cv::RNG random(5);
  std::vector<Silhouette> views;
  const int count = GENERATE(2, 9);
  for (int k = 0; k < count; ++k) views.push_back(patchy(count == 2 ? 60 : 250, random));
  const int needed = count == 2 ? 2 : 3;
  std::vector<float> depths;
  for (int k = 0; k < 37; ++k) depths.push_back(0.3f + 0.17f * float(k));
  int inside = 0, unclear = 0;
  for (int k = 0; k < 300; ++k) {
    const View& view = views[0].view;
    const cv::Vec3d ray = view.ray(random.uniform(0.0, 320.0), random.uniform(0.0, 240.0));
    std::vector<std::uint8_t> outside;
    find_outside(views, view.centre, ray, depths, 0.5, &outside);
    REQUIRE(outside.size() == depths.size());
    for (std::size_t i = 0; i < depths.size(); ++i) {
      int hits = 0, misses = 0;
      for (const Silhouette& s : views) {
        const Relation relation = relation_of(s, view.centre + depths[i] * ray, 0.5);
        hits += relation == Relation::kInside ? 1 : 0;
        misses += relation == Relation::kOutside ? 1 : 0;
      }
      const int seen = hits + misses;
      const bool expected = hits >= needed && misses <= seen / 8 + (seen >= 5 ? 1 : 0);
      inside += expected ? 1 : 0;
      unclear += (outside[i] == 0) != expected ? 1 : 0;  // single precision, next to a pixel's edge
    }
  }
  CHECK(inside > 20);
  CHECK(unclear < 5);
}

TEST_CASE("no hull without motion") {
  std::vector<Silhouette> still;
  for (int k = 0; k < kViews; ++k) {
    const View view = view_at(k);
    still.push_back(make_silhouette(view, cv::Mat(view.size(), CV_8U, cv::Scalar(0)), {}));
  }
  CHECK_FALSE(still[0].shows_motion);
  CHECK_FALSE(is_in_hull(still, {0, 0, 0}, 0.5));
  CHECK_FALSE(is_in_hull({}, {0, 0, 0}, 0.5));
}
