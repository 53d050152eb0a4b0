// SPDX-License-Identifier: Apache-2.0
// Views of the C interface: image size.
#include <array>
#include <cmath>

#include "sdk_fixture.h"

namespace stgs::testing {
namespace {

stgs_view default_view() {
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  return view;
}

// Tangents of the angles to the left, top, right and bottom edge of the image.
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

TEST_CASE("a resized view keeps pixels square and shows at least what it showed", "[sdk]") {
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
    const auto was = extent_of(before), is = extent_of(view);
    for (std::size_t i = 0; i < 4; ++i) CHECK(is[i] >= was[i] * (1 - 1e-6));
    // One axis is fitted exactly.
    CHECK((is[0] == Approx(was[0]) || is[1] == Approx(was[1])));
    // The fovea keeps its direction and its share of the view angle.
    CHECK((view.fovea_x - view.cx) / view.fx == Approx((150 - 120) / 200.0).margin(1e-5));
    CHECK((view.fovea_y - view.cy) / view.fy == Approx((90 - 210) / 200.0).margin(1e-5));
    CHECK(view.fovea_radius / view.fx == Approx(40 / 200.0));
  }
}

TEST_CASE("a resized view keeps the shape of its pixels", "[sdk]") {
  stgs_view view = off_centre_view();
  view.fy = 2 * view.fx;
  REQUIRE(stgs_view_resize(&view, 1280, 720) == STGS_OK);
  CHECK(view.fy == 2 * view.fx);
}

TEST_CASE("a stretched view scales each axis on its own", "[sdk]") {
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
  const auto was = extent_of(before), is = extent_of(view);
  for (std::size_t i = 0; i < 4; ++i) CHECK(is[i] == Approx(was[i]));
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

}  // namespace stgs::testing
