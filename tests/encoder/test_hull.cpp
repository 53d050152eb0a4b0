// SPDX-License-Identifier: Apache-2.0
// The visual hull of a ball, within bounds of any size.
#include "init/hull.h"

#include <algorithm>
#include <cmath>
#include <memory>
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
    cv::Mat mask(view.size(), CV_8U, cv::Scalar(0));
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const cv::Vec3d ray = cv::normalize(view.ray(x + 0.5, y + 0.5));
        const cv::Vec3d away = kMiddle - view.centre;
        if (cv::norm(away - away.dot(ray) * ray) < kBall) mask.at<std::uint8_t>(y, x) = 255;
      }
    }
    std::shared_ptr<const Backdrop> backdrop;
    if (behind > 0) {
      backdrop = std::make_shared<const Backdrop>(
          make_backdrop(cv::Mat(view.size(), CV_32F, cv::Scalar(behind))));
    }
    out.push_back(make_silhouette(view, mask, backdrop));
  }
  return out;
}

// The sum of the volumes of the cells, scene units^3.
double volume_of(const std::vector<HullCell>& cells) {
  double sum = 0;
  for (const HullCell& cell : cells) sum += cell.side * cell.side * cell.side;
  return sum;
}

bool is_in_hull(const std::vector<Silhouette>& views, const cv::Vec3d& point, double nearest) {
  std::vector<std::uint8_t> outside;
  find_outside(views, point, {0, 0, 0}, {0.0f}, nearest, &outside);
  return outside[0] == 0;
}

// Whether a point is in a cell or next to one.
bool is_near(const std::vector<HullCell>& cells, const cv::Vec3d& point) {
  return std::any_of(cells.begin(), cells.end(), [&](const HullCell& cell) {
    return cv::norm(point - cell.centre, cv::NORM_INF) <= cell.side;
  });
}

// A view with patches of motion, of unknown and of near static surface.
Silhouette patchy(cv::RNG& random) {
  const View view = view_at(0);
  cv::Mat mask(view.size(), CV_8U, cv::Scalar(0)), depth(view.size(), CV_32F, cv::Scalar(5));
  for (int k = 0; k < 12; ++k) {
    const cv::Point p(random.uniform(0, view.width), random.uniform(0, view.height));
    const cv::Rect box = cv::Rect(p.x, p.y, 60, 60) & cv::Rect({0, 0}, view.size());
    if (k % 3 == 0) mask(box).setTo(255);
    if (k % 3 == 1) depth(box).setTo(0);
    if (k % 3 == 2) depth(box).setTo(random.uniform(2.0, 6.0));
  }
  return make_silhouette(view, mask, std::make_shared<const Backdrop>(make_backdrop(depth)));
}

}  // namespace

TEST_CASE("cells are about the hull of a ball, however far the bounds reach") {
  const double reach = GENERATE(1.5, 30.0, 400.0);
  const double behind = GENERATE(0.0, 9.0);
  const Box bounds{cv::Vec3d::all(-reach), cv::Vec3d::all(1.1 * reach)};
  const std::vector<Silhouette> views = silhouettes(behind);
  const std::vector<HullCell> cells = hull_cells(views, bounds, 0.5, {kSide, kRing});
  const double ball = 4.0 / 3 * CV_PI * std::pow(kBall, 3);
  CHECK(volume_of(cells) > 0.9 * ball);
  CHECK(volume_of(cells) < 2 * ball);
  cv::RNG random(3);
  for (int k = 0; k < 200; ++k) {
    const cv::Vec3d away(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0),
                         random.uniform(-1.0, 1.0));
    const cv::Vec3d point = kMiddle + 1.5 * kBall * away;
    if (cv::norm(point - kMiddle) < 0.95 * kBall) CHECK(is_in_hull(views, point, 0.5));
    if (is_in_hull(views, point, 0.5)) CHECK(is_near(cells, point));
  }
  CHECK_FALSE(is_in_hull(views, kMiddle + cv::Vec3d(0, 1.3 * kBall, 0), 0.5));
  for (const HullCell& cell : cells) CHECK(cv::norm(cell.centre - kMiddle) < 2 * kBall);
}

TEST_CASE("cells far from the views are larger, and none is outside the bounds") {
  std::vector<Silhouette> everything = silhouettes(0);
  for (Silhouette& s : everything)
    s = make_silhouette(s.view, cv::Mat(s.view.size(), CV_8U, cv::Scalar(255)), {});
  const Box bounds{cv::Vec3d(-40, -4, -40), cv::Vec3d(40, 4, 40)};
  const std::vector<HullCell> cells = hull_cells(everything, bounds, 0.5, {0.05, kRing});
  CHECK(cells.size() <= 2'000'000);  // with the requested size there would be about ten million
  double nearest = 1e300, farthest = 0;
  for (const HullCell& cell : cells) {
    nearest = std::min(nearest, cell.side);
    farthest = std::max(farthest, cell.side);
    CHECK(std::abs(cell.centre[1]) < 4 + 0.5 * cell.side);
  }
  CHECK(farthest >= 4 * nearest);
}

TEST_CASE("a relation of a ball holds for its points") {
  cv::RNG random(7);
  const Silhouette silhouette = patchy(random);
  const auto within = [&](double low, double high) { return random.uniform(low, high); };
  int decided[3] = {};
  for (int k = 0; k < 4000; ++k) {
    const cv::Vec3d centre =
        silhouette.view.at(within(-40, 360), within(-40, 280), within(-0.5, 7));
    const double radius = within(0.01, 0.5);
    const Relation ball = relation_of_ball(silhouette, centre, radius, 0.5);
    if (ball == Relation::kUndecided) continue;
    if (ball != Relation::kNotInside) ++decided[int(ball)];
    for (int i = 0; i < 20; ++i) {
      const cv::Vec3d away(within(-1, 1), within(-1, 1), within(-1, 1));
      const cv::Vec3d point = centre + radius * within(0, 1) / cv::norm(away) * away;
      const Relation found = relation_of_point(silhouette, point, 0.5);
      CHECK((ball == Relation::kNotInside ? found != Relation::kInside : found == ball));
    }
  }
  for (const int count : decided) CHECK(count > 20);
}

TEST_CASE("points of a ray get the votes of single points") {
  cv::RNG random(5);
  const std::vector<Silhouette> views{patchy(random), patchy(random)};
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
        const Relation relation = relation_of_point(s, view.centre + depths[i] * ray, 0.5);
        hits += relation == Relation::kInside ? 1 : 0;
        misses += relation == Relation::kOutside ? 1 : 0;
      }
      const bool expected = hits == 2 && misses == 0;
      inside += expected ? 1 : 0;
      unclear += (outside[i] == 0) != expected ? 1 : 0;  // single precision, next to a pixel's edge
    }
  }
  CHECK(inside > 20);
  CHECK(unclear < 3);
}

TEST_CASE("no hull without silhouettes, motion or bounds") {
  const Box bounds{cv::Vec3d::all(-2), cv::Vec3d::all(2)};
  CHECK(hull_cells({}, bounds, 0.5, {kSide, kRing}).empty());
  CHECK(hull_cells(silhouettes(0), Box{}, 0.5, {kSide, kRing}).empty());
  std::vector<Silhouette> still;
  for (int k = 0; k < kViews; ++k) {
    const View view = view_at(k);
    still.push_back(make_silhouette(view, cv::Mat(view.size(), CV_8U, cv::Scalar(0)), {}));
  }
  CHECK_FALSE(still[0].shows_motion());
  CHECK(hull_cells(still, bounds, 0.5, {kSide, kRing}).empty());
  CHECK_FALSE(is_in_hull(still, {0, 0, 0}, 0.5));
}
