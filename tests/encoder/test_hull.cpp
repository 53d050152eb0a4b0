// SPDX-License-Identifier: Apache-2.0
// The visual hull of a ball, within bounds of any size.
#include "init/hull.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "catch.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;

namespace {

constexpr int kViews = 10;
constexpr double kRing = 4, kBall = 0.4, kSide = 0.02;
const cv::Vec3d kMiddle(0.3, -0.2, 0.1);

// A view from the ring, towards the origin.
View view_at(int k) {
  const double angle = 2 * CV_PI * k / kViews;
  const cv::Vec3d z(-std::cos(angle), 0, -std::sin(angle)), y(0, 1, 0), x = y.cross(z);
  View view;
  view.width = 320;
  view.height = 240;
  view.fx = view.fy = 240;
  view.cx = 160;
  view.cy = 120;
  view.rotation = cv::Matx33d(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]);
  view.centre = -kRing * z;
  view.translation = -(view.rotation * view.centre);
  return view;
}

// The silhouettes of the ball in front of a background at depth `behind` (0: none).
std::vector<Silhouette> silhouettes(double behind) {
  std::vector<Silhouette> out;
  for (int k = 0; k < kViews; ++k) {
    const View view = view_at(k);
    cv::Mat mask(view.size(), CV_8U, cv::Scalar(0)), depth;
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const cv::Vec3d ray = cv::normalize(view.ray(x + 0.5, y + 0.5));
        const cv::Vec3d away = kMiddle - view.centre;
        if (cv::norm(away - away.dot(ray) * ray) < kBall) mask.at<std::uint8_t>(y, x) = 255;
      }
    }
    if (behind > 0) depth = cv::Mat(view.size(), CV_32F, cv::Scalar(behind));
    out.push_back(make_silhouette(view, mask, depth));
  }
  return out;
}

}  // namespace

TEST_CASE("the hull of a ball is about the ball, however far the bounds reach") {
  const double reach = GENERATE(1.5, 30.0, 400.0);
  const double behind = GENERATE(0.0, 9.0);
  const Box bounds{cv::Vec3d::all(-reach), cv::Vec3d::all(1.1 * reach)};
  const VisualHull hull = VisualHull::carve(silhouettes(behind), bounds, 0.5, {kSide, kRing});
  REQUIRE_FALSE(hull.empty());
  const double ball = 4.0 / 3 * CV_PI * std::pow(kBall / kSide, 3);
  CHECK(double(hull.count()) > 0.9 * ball);
  CHECK(hull.contains(kMiddle));
  CHECK(hull.contains(kMiddle + cv::Vec3d(0, 0, 0.9 * kBall)));
  CHECK_FALSE(hull.contains(kMiddle + cv::Vec3d(0, 1.3 * kBall, 0)));
  CHECK_FALSE(hull.contains(cv::Vec3d::all(3 * reach)));

  const std::vector<HullCell> surface = hull.surface();
  CHECK(surface.size() < hull.count() / 2);
  for (const HullCell& cell : surface) {
    const double distance = cv::norm(cell.centre - kMiddle);
    CHECK(distance < 2 * kBall);
    CHECK(distance > kBall - 3 * cell.side);
    CHECK(hull.contains(cell.centre));
  }
}

TEST_CASE("cells far from the views are larger, and none is outside the bounds") {
  std::vector<Silhouette> everything = silhouettes(0);
  for (Silhouette& s : everything)
    s = make_silhouette(s.view, cv::Mat(s.view.size(), CV_8U, cv::Scalar(255)), {});
  const Box bounds{cv::Vec3d(-40, -4, -40), cv::Vec3d(40, 4, 40)};
  const VisualHull hull = VisualHull::carve(everything, bounds, 0.5, {0.05, kRing});
  CHECK(hull.count() <= 2'000'000);  // with the requested size there would be about ten million
  CHECK(hull.contains({0, 0, 0}));
  CHECK_FALSE(hull.contains({0, 4.9, 0}));
  double nearest = 1e300, farthest = 0;
  for (const HullCell& cell : hull.surface()) {
    nearest = std::min(nearest, cell.side);
    farthest = std::max(farthest, cell.side);
    CHECK(std::abs(cell.centre[1]) < 4 + 0.5 * cell.side);
  }
  CHECK(farthest >= 4 * nearest);
}

TEST_CASE("no hull without silhouettes, motion or bounds") {
  const Box bounds{cv::Vec3d::all(-2), cv::Vec3d::all(2)};
  CHECK(VisualHull::carve({}, bounds, 0.5, {kSide, kRing}).empty());
  CHECK(VisualHull::carve(silhouettes(0), Box{}, 0.5, {kSide, kRing}).empty());
  std::vector<Silhouette> still;
  for (int k = 0; k < kViews; ++k) {
    const View view = view_at(k);
    still.push_back(make_silhouette(view, cv::Mat(view.size(), CV_8U, cv::Scalar(0)), {}));
  }
  const VisualHull hull = VisualHull::carve(still, bounds, 0.5, {kSide, kRing});
  CHECK(hull.empty());
  CHECK(hull.surface().empty());
  CHECK_FALSE(hull.contains({0, 0, 0}));
}
