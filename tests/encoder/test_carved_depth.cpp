// SPDX-License-Identifier: Apache-2.0
// Depth that other views contradict, in front of a wall that they confirm.
#include "init/carved_depth.h"

#include <algorithm>

#include "catch.h"
#include "init/static_points.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;

namespace {

constexpr int kSide = 64;
constexpr double kWall = 10;  // depth of the wall
const cv::Vec3d kThing(0.3, -0.2, 5);
const cv::Point kPixel(34, 30);  // of the thing, in the first view

// A view along z from (x, 0, 0), with a confirmed wall but around the image of the thing.
Surface surface_at(double x) {
  View view;
  view.width = view.height = kSide;
  view.fx = view.fy = 50;
  view.cx = view.cy = 0.5 * kSide;
  view.rotation = cv::Matx33d::eye();
  view.centre = {x, 0, 0};
  view.translation = -view.centre;
  Surface surface{view, cv::Mat(view.size(), CV_8UC3, cv::Scalar::all(90)),
                  cv::Mat(view.size(), CV_32F, cv::Scalar(kWall)),
                  cv::Mat(view.size(), CV_32F, cv::Scalar(kStereoWeight))};
  const Pixel p = project(view, kThing);
  REQUIRE(p.inside);
  surface.weight(cv::Rect(p.x() - 2, p.y() - 2, 5, 5)).setTo(0);
  return surface;
}

void carve(std::vector<Surface>& surfaces) {
  const ProgressSink progress;
  const LogSink log = [](int, const std::string&) {};
  Work work(progress, log);
  REQUIRE(carve_depth(2, 20, work, &surfaces).ok());
}

}  // namespace

TEST_CASE("contradicted depth moves to the nearest depth that no view contradicts") {
  const double given = GENERATE(3.2, 3.6, 7.0);
  std::vector<Surface> surfaces = {surface_at(0), surface_at(1), surface_at(-1)};
  surfaces[0].depth.setTo(given, surfaces[0].weight <= 0);
  CHECK(is_contradicted(surfaces, surfaces[0].view.at(kPixel.x + 0.5, kPixel.y + 0.5, given)));
  carve(surfaces);
  const float depth = surfaces[0].depth.at<float>(kPixel);
  CHECK(depth > 3.8);
  CHECK(depth < 6.8);
  CHECK_FALSE(
      is_contradicted(surfaces, surfaces[0].view.at(kPixel.x + 0.5, kPixel.y + 0.5, depth)));
}

TEST_CASE("confirmed depth and depth that no view contradicts stay") {
  std::vector<Surface> surfaces = {surface_at(0), surface_at(1), surface_at(-1)};
  surfaces[0].depth.setTo(5, surfaces[0].weight <= 0);
  surfaces[0].depth.at<float>(3, 3) = 2;  // confirmed
  carve(surfaces);
  CHECK(std::abs(surfaces[0].depth.at<float>(kPixel) - 5) < 1e-5);
  CHECK(surfaces[0].depth.at<float>(3, 3) == 2);
  CHECK(surfaces[1].depth.at<float>(3, 3) == float(kWall));
}

TEST_CASE("depth stays where every depth is contradicted") {
  std::vector<Surface> surfaces = {surface_at(0), surface_at(0.5)};
  surfaces[1].depth.setTo(1000);
  surfaces[1].weight.setTo(kStereoWeight);
  surfaces[0].depth.setTo(3, surfaces[0].weight <= 0);
  carve(surfaces);
  CHECK(std::abs(surfaces[0].depth.at<float>(kPixel) - 3) < 1e-5);
}

TEST_CASE("swept depth contradicts no interpolated point, and choosing points keeps its weights") {
  StaticScene scene;
  scene.range = {2, 20, true};
  for (const double x : {0.0, 1.0, -1.0}) {
    Surface& surface = scene.surfaces.emplace_back(surface_at(x));
    surface.weight.setTo(1, surface.weight > 0);
    scene.usable.emplace_back(surface.weight.size(), CV_8U, cv::Scalar(255));
  }
  Surface& first = scene.surfaces[0];
  first.weight(cv::Rect(kPixel.x - 8, kPixel.y - 8, 16, 16)).setTo(0);
  first.depth.setTo(5, first.weight <= 0);
  const cv::Mat weight = first.weight.clone();
  choose_static_points({}, 5000, &scene);
  CHECK(cv::norm(first.weight, weight, cv::NORM_INF) == 0);
  CHECK(scene.filled > 0);
  CHECK(std::any_of(scene.points.begin(), scene.points.end(),
                    [](const SurfacePoint& point) { return point.position[2] < 6; }));
}
