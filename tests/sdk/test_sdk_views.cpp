// SPDX-License-Identifier: Apache-2.0
// Views of the C API: image size, look-at and orbit.
#include <array>
#include <cmath>
#include <numbers>

#include "sdk_fixture.h"

namespace stgs::testing {
namespace {

using Vector = std::array<double, 3>;

stgs_view default_view() {
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  return view;
}

Vector in_camera(const stgs_view& view, const Vector& point) {
  Vector out{};
  for (std::size_t row = 0; row < 3; ++row) {
    out[row] = view.translation[row];
    for (std::size_t i = 0; i < 3; ++i) out[row] += view.rotation[3 * row + i] * point[i];
  }
  return out;
}

Vector position_of(const stgs_view& view) {
  Vector out{};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t i = 0; i < 3; ++i) {
      out[i] -= view.rotation[3 * row + i] * view.translation[row];
    }
  }
  return out;
}

std::array<double, 2> pixel_of(const stgs_view& view, const Vector& point) {
  const Vector p = in_camera(view, point);
  REQUIRE(p[2] > 0);
  return {view.fx * p[0] / p[2] + view.cx, view.fy * p[1] / p[2] + view.cy};
}

double distance(const Vector& a, const Vector& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

// Tangents of the angles from the optical axis to the left, top, right and bottom edges of the
// image.
std::array<double, 4> extent_of(const stgs_view& view) {
  const double width = view.width, height = view.height;
  return {view.cx / view.fx, view.cy / view.fy, (width - view.cx) / view.fx,
          (height - view.cy) / view.fy};
}

stgs_view off_centre_view() {
  stgs_view view = default_view();
  view.width = 400;
  view.height = 300;
  view.fx = view.fy = 200;
  view.cx = 120;
  view.cy = 210;
  view.fovea_x = 150;
  view.fovea_y = 90;
  view.fovea_radius = 40;
  return view;
}

}  // namespace

TEST_CASE("a resized view keeps pixels square and its field of view does not shrink", "[sdk]") {
  const stgs_view before = off_centre_view();
  const std::pair<std::uint32_t, std::uint32_t> sizes[] = {{1280, 720}, {720, 1280}, {200, 150},
                                                           {50, 50},    {400, 300},  {1, 1}};
  for (const auto& [width, height] : sizes) {
    INFO(width << "x" << height);
    stgs_view view = before;
    REQUIRE(stgs_view_resize(&view, width, height) == STGS_OK);
    CHECK(view.width == width);
    CHECK(view.height == height);
    CHECK(view.fx == view.fy);
    CHECK(view.cx / static_cast<float>(width) == Approx(before.cx / 400));
    CHECK(view.cy / static_cast<float>(height) == Approx(before.cy / 300));
    const auto old_extent = extent_of(before), new_extent = extent_of(view);
    for (std::size_t i = 0; i < 4; ++i) CHECK(new_extent[i] >= old_extent[i] * (1 - 1e-6));
    // One axis is fitted exactly.
    CHECK((new_extent[0] == Approx(old_extent[0]) || new_extent[1] == Approx(old_extent[1])));
    // The fovea keeps its direction and its share of the view angle.
    CHECK((view.fovea_x - view.cx) / view.fx == Approx((150 - 120) / 200.0).margin(1e-5));
    CHECK((view.fovea_y - view.cy) / view.fy == Approx((90 - 210) / 200.0).margin(1e-5));
    CHECK(view.fovea_radius / view.fx == Approx(40 / 200.0));
  }
}

TEST_CASE("a resized view keeps its pixel aspect ratio", "[sdk]") {
  stgs_view view = off_centre_view();
  view.fy = 2 * view.fx;
  REQUIRE(stgs_view_resize(&view, 1280, 720) == STGS_OK);
  CHECK(view.fy == 2 * view.fx);
}

TEST_CASE("a stretched view scales each axis independently", "[sdk]") {
  const stgs_view before = off_centre_view();
  stgs_view view = before;
  REQUIRE(stgs_view_stretch(&view, 800, 150) == STGS_OK);
  CHECK(view.fx == 400);
  CHECK(view.fy == 100);
  CHECK(view.cx == 240);
  CHECK(view.cy == 105);
  CHECK(view.fovea_x == 300);
  CHECK(view.fovea_y == 45);
  CHECK(view.fovea_radius == 40);
  const auto old_extent = extent_of(before), new_extent = extent_of(view);
  for (std::size_t i = 0; i < 4; ++i) CHECK(new_extent[i] == Approx(old_extent[i]));
}

TEST_CASE("sizes out of range leave a view unchanged", "[sdk]") {
  for (const auto function : {stgs_view_resize, stgs_view_stretch}) {
    stgs_view view = off_centre_view();
    CHECK(function(&view, 0, 100) == STGS_ERROR_ARGUMENT);
    CHECK(function(&view, 100, STGS_MAX_SIDE + 1) == STGS_ERROR_ARGUMENT);
    CHECK(function(nullptr, 100, 100) == STGS_ERROR_ARGUMENT);
    view.fx = view.fy = 3e38f;
    CHECK(function(&view, 32768, 32768) == STGS_ERROR_ARGUMENT);
    CHECK(view.width == 400);
    CHECK(view.fx == 3e38f);
    view.struct_size = 12;
    CHECK(function(&view, 100, 100) == STGS_ERROR_STRUCT_SIZE);
  }
}

TEST_CASE("look-at centres the target and keeps the view upright", "[sdk]") {
  stgs_view view = off_centre_view();
  const float eye[] = {3, -2, 1}, target[] = {-1, 0.5f, 6}, up[] = {0, 0, 10};
  REQUIRE(stgs_view_look_at(&view, eye, target, up) == STGS_OK);
  CHECK(distance(position_of(view), {3, -2, 1}) < 1e-5);
  const auto pixel = pixel_of(view, {-1, 0.5, 6});
  CHECK(pixel[0] == Approx(view.cx).margin(1e-3));
  CHECK(pixel[1] == Approx(view.cy).margin(1e-3));
  // A point above the target appears directly above it in the image.
  const auto above = pixel_of(view, {-1, 0.5, 6.5});
  CHECK(above[0] == Approx(pixel[0]).margin(1e-3));
  CHECK(above[1] < pixel[1]);
  CHECK(view.fx == off_centre_view().fx);
  // Valid for rendering.
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  CHECK(render_rgba8(cpu_renderer().get(), scene.get(), 0.1, view).size() == 4 * 400 * 300);
}

TEST_CASE("look-at without an up direction keeps that of the view", "[sdk]") {
  const float eye[] = {0, 0, -5}, target[] = {0, 0, 0}, none[] = {0, 0, 0};
  for (const float* up : {static_cast<const float*>(nullptr), none}) {
    stgs_view view = default_view();
    REQUIRE(stgs_view_look_at(&view, eye, target, up) == STGS_OK);
    const stgs_view level = default_view();
    for (int i = 0; i < 9; ++i) CHECK(view.rotation[i] == Approx(level.rotation[i]).margin(1e-6));
    CHECK(view.translation[2] == Approx(5));
  }
}

TEST_CASE("invalid directions are rejected and leave a view unchanged", "[sdk]") {
  const stgs_view before = off_centre_view();
  stgs_view view = before;
  const float a[] = {1, 2, 3}, b[] = {1, 2, 8}, z[] = {0, 0, -2}, nan[] = {0, NAN, 0};
  CHECK(stgs_view_look_at(&view, a, a, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_look_at(&view, a, b, z) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_look_at(&view, nan, b, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_look_at(&view, a, b, nan) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_look_at(&view, nullptr, b, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_look_at(nullptr, a, b, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_orbit(&view, nullptr, nullptr, 1, 0) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_orbit(&view, a, nullptr, NAN, 0) == STGS_ERROR_ARGUMENT);
  const float at_camera[] = {0, 0, 0};
  CHECK(stgs_view_orbit(&view, at_camera, nullptr, 1, 0) == STGS_ERROR_ARGUMENT);
  CHECK(std::equal(view.rotation, view.rotation + 9, before.rotation));
  CHECK(std::equal(view.translation, view.translation + 3, before.translation));
  view.rotation[0] = 2;
  CHECK(stgs_view_orbit(&view, a, nullptr, 1, 0) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_view_look_at(&view, a, b, nullptr) == STGS_ERROR_ARGUMENT);
}

TEST_CASE("an orbit keeps the centre at its pixel and returns to the start", "[sdk]") {
  stgs_view view = off_centre_view();
  const float eye[] = {1, -1, -4}, target[] = {0, 0.2f, 0}, up[] = {0, -1, 0};
  const float centre[] = {0.3f, 0.1f, 0.5f};
  const Vector middle = {centre[0], centre[1], centre[2]};
  REQUIRE(stgs_view_look_at(&view, eye, target, up) == STGS_OK);
  const stgs_view first = view;
  const auto pixel = pixel_of(view, middle);
  const double radius = distance(position_of(view), middle);
  constexpr int kSteps = 360;
  for (int i = 0; i < kSteps; ++i) {
    REQUIRE(stgs_view_orbit(&view, centre, up, 2 * std::numbers::pi / kSteps, 0) == STGS_OK);
    const auto now = pixel_of(view, middle);
    REQUIRE(now[0] == Approx(pixel[0]).margin(0.05));
    REQUIRE(now[1] == Approx(pixel[1]).margin(0.05));
    REQUIRE(distance(position_of(view), middle) == Approx(radius).epsilon(1e-4));
    REQUIRE(position_of(view)[1] == Approx(-1).margin(1e-3));  // at constant height
  }
  CHECK(distance(position_of(view), position_of(first)) < 1e-3);
}

TEST_CASE("a positive azimuth moves the camera to its right, a positive elevation up", "[sdk]") {
  stgs_view view = default_view();
  const float eye[] = {0, 0, -5}, origin[] = {0, 0, 0}, up[] = {0, -1, 0};
  REQUIRE(stgs_view_look_at(&view, eye, origin, up) == STGS_OK);
  stgs_view right = view;
  REQUIRE(stgs_view_orbit(&right, origin, up, std::numbers::pi / 2, 0) == STGS_OK);
  CHECK(distance(position_of(right), {5, 0, 0}) < 1e-5);
  stgs_view high = view;
  REQUIRE(stgs_view_orbit(&high, origin, up, 0, std::numbers::pi / 6) == STGS_OK);
  CHECK(position_of(high)[1] == Approx(-2.5));
  CHECK(high.rotation[1] == Approx(0).margin(1e-6));  // its x axis stays level
  // The elevation stops one degree from the pole and can decrease again.
  stgs_view pole = view;
  for (int i = 0; i < 10; ++i) REQUIRE(stgs_view_orbit(&pole, origin, up, 0, 1) == STGS_OK);
  CHECK(position_of(pole)[1] == Approx(-5 * std::sin(89 * std::numbers::pi / 180)));
  REQUIRE(stgs_view_orbit(&pole, origin, up, 0, -89 * std::numbers::pi / 180) == STGS_OK);
  CHECK(distance(position_of(pole), position_of(view)) < 1e-3);
  // A view from directly above can be lowered around its own x axis.
  const float above[] = {0, -5, 0}, north[] = {0, 0, 1};
  REQUIRE(stgs_view_look_at(&view, above, origin, north) == STGS_OK);
  REQUIRE(stgs_view_orbit(&view, origin, up, 0, -std::numbers::pi / 2) == STGS_OK);
  CHECK(distance(position_of(view), {0, 0, -5}) < 1e-4);
}

}  // namespace stgs::testing
