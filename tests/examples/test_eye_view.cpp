// SPDX-License-Identifier: Apache-2.0
// The example hello_openxr: an OpenXR eye projects points of the scene as OpenXR defines it.
#include "xr/eye_view.h"

#include <array>
#include <cmath>

#include "catch.h"

namespace {

using Vector = std::array<double, 3>;

constexpr std::uint32_t kWidth = 320, kHeight = 200;

// OpenXR's definition: rotate a point into the eye's axes (x right, y up, z back), then project it
// onto the image between the frustum's angles, row 0 at the top.
Vector rotate_inverse(const XrQuaternionf& q, const Vector& v) {
  const double x = -q.x, y = -q.y, z = -q.z, w = q.w;
  const Vector t = {2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]),
                    2 * (x * v[1] - y * v[0])};
  return {v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2],
          v[2] + w * t[2] + x * t[1] - y * t[0]};
}
std::array<double, 2> pixel_of(const XrView& eye, const Vector& point) {
  const XrVector3f& p = eye.pose.position;
  const Vector v =
      rotate_inverse(eye.pose.orientation, {point[0] - p.x, point[1] - p.y, point[2] - p.z});
  const double left = std::tan(eye.fov.angleLeft), right = std::tan(eye.fov.angleRight);
  const double up = std::tan(eye.fov.angleUp), down = std::tan(eye.fov.angleDown);
  return {kWidth * (v[0] / -v[2] - left) / (right - left),
          kHeight * (up - v[1] / -v[2]) / (up - down)};
}

// Maps a point of the viewer's space into the scene.
Vector in_scene(const xr::Anchor& anchor, const Vector& point) {
  const double flipped[] = {point[0], -point[1], -point[2]};
  Vector out = {anchor.position[0], anchor.position[1], anchor.position[2]};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      out[i] += anchor.units_per_metre * anchor.rotation[3 * k + i] * flipped[k];
    }
  }
  return out;
}

Vector in_camera(const stgs_view& view, const Vector& point) {
  Vector out{};
  for (std::size_t i = 0; i < 3; ++i) {
    out[i] = view.translation[i];
    for (std::size_t k = 0; k < 3; ++k) out[i] += view.rotation[3 * i + k] * point[k];
  }
  return out;
}

// A view with yaw and pitch, away from the origin.
stgs_view start_view() {
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  const float a = 0.6f, b = 0.3f, ca = std::cos(a), sa = std::sin(a), cb = std::cos(b),
              sb = std::sin(b);
  const float rows[9] = {ca, 0, -sa, sa * sb, cb, ca * sb, sa * cb, -sb, ca * cb};
  std::copy_n(rows, 9, view.rotation);
  view.translation[0] = 0.4f;
  view.translation[1] = -0.2f;
  view.translation[2] = 1.5f;
  return view;
}

stgs_scene_info scene_info() {
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  return info;
}

XrView eye() {
  XrView out{};
  out.fov = {-0.9f, 0.7f, 0.6f, -0.8f};
  out.pose.orientation = {0.1f, 0.3f, -0.05f, 0};
  auto& q = out.pose.orientation;
  q.w = std::sqrt(1 - q.x * q.x - q.y * q.y - q.z * q.z);
  out.pose.position = {0.03f, 0.2f, -0.1f};
  return out;
}

void check_points(const stgs_scene_info& info) {
  const stgs_view start = start_view();
  const xr::Anchor anchor = xr::anchor_at(start, info);
  const stgs_view view = xr::eye_view(eye(), anchor, start, kWidth, kHeight);
  CHECK(view.width == kWidth);
  CHECK(view.near_plane == start.near_plane);
  for (const Vector& point : {Vector{0, 0, -2}, Vector{-1, 0.5, -3}, Vector{0.2, -0.7, -1.5}}) {
    const Vector v = in_camera(view, in_scene(anchor, point));
    const auto expected = pixel_of(eye(), point);
    CHECK(v[2] > 0);
    CHECK(view.fx * v[0] / v[2] + view.cx == Approx(expected[0]).margin(1e-3));
    CHECK(view.fy * v[1] / v[2] + view.cy == Approx(expected[1]).margin(1e-3));
  }
}

}  // namespace

TEST_CASE("an eye with an asymmetric frustum projects points like OpenXR") {
  check_points(scene_info());
}

TEST_CASE("the anchor uses the scene's metres and up direction") {
  stgs_scene_info info = scene_info();
  info.metres_per_unit = 0.5f;
  info.up[0] = 0.6f;
  info.up[1] = -0.8f;
  check_points(info);
  const stgs_view start = start_view();
  const xr::Anchor anchor = xr::anchor_at(start, info);
  CHECK(anchor.units_per_metre == 2);
  const Vector above = in_scene(anchor, {0, 1, 0}), origin = in_scene(anchor, {0, 0, 0});
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(above[i] - origin[i] == Approx(2 * info.up[i]).margin(1e-6));
  }
  // The origin is the start camera's position, and forward is its viewing direction.
  const Vector camera = in_camera(start, origin);
  for (const double c : camera) CHECK(c == Approx(0).margin(1e-6));
  const Vector ahead = in_camera(start, in_scene(anchor, {0, 0, -1}));
  CHECK(ahead[2] > 0.5);
}
