// SPDX-License-Identifier: Apache-2.0
#include "eye_view.h"

#include <algorithm>
#include <cmath>

namespace xr {
namespace {

// Converts between axes x right, y up, z back and x right, y down, z forward.
constexpr float kFlip[3] = {1, -1, -1};

float dot(const float* a, const float* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void normalise(float* v) {
  const float length = std::sqrt(dot(v, v));
  for (int i = 0; i < 3; ++i) v[i] /= length;
}

// Rotation matrix of a unit quaternion, row-major: out = rotation * in.
void rotation_of(const XrQuaternionf& q, float* out) {
  const float x = q.x, y = q.y, z = q.z, w = q.w;
  const float rows[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                         2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                         2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  std::copy_n(rows, 9, out);
}

// Rotates the axes so that down is opposite to `up`, and keeps the viewing direction as far as
// possible.
void level(const float* up, float* rotation) {
  float* right = rotation;
  float* down = rotation + 3;
  float* forward = rotation + 6;
  const float rise = dot(forward, up);
  // Looking straight up or down leaves no horizontal direction.
  if (std::abs(rise) > 0.99f) return;
  for (int i = 0; i < 3; ++i) {
    down[i] = -up[i];
    forward[i] -= rise * up[i];
  }
  normalise(forward);
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    right[i] = down[j] * forward[k] - down[k] * forward[j];
  }
}

}  // namespace

Anchor anchor_at(const stgs_view& start, const stgs_scene_info& info) {
  Anchor anchor{};
  std::copy_n(start.rotation, 9, anchor.rotation);
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) {
      anchor.position[i] -= start.rotation[3 * k + i] * start.translation[k];
    }
  }
  if (dot(info.up, info.up) > 0) level(info.up, anchor.rotation);
  anchor.units_per_metre = info.metres_per_unit > 0 ? 1 / info.metres_per_unit : 1;
  return anchor;
}

stgs_view eye_view(const XrView& eye, const Anchor& anchor, const stgs_view& start, uint32_t width,
                   uint32_t height) {
  stgs_view view = start;
  std::fill_n(view.background, 3, 0.0f);
  view.width = width;
  view.height = height;
  const float left = std::tan(eye.fov.angleLeft), right = std::tan(eye.fov.angleRight);
  const float up = std::tan(eye.fov.angleUp), down = std::tan(eye.fov.angleDown);
  view.fx = static_cast<float>(width) / (right - left);
  view.fy = static_cast<float>(height) / (up - down);
  view.cx = -left * view.fx;
  view.cy = up * view.fy;
  // camera = flip * head^T * (space - position) and space = flip * anchor * (scene -
  // anchor.position), with the tracking space in scene units.
  float head[9];
  rotation_of(eye.pose.orientation, head);
  const float position[3] = {eye.pose.position.x, eye.pose.position.y, eye.pose.position.z};
  for (int i = 0; i < 3; ++i) {
    view.translation[i] = 0;
    for (int j = 0; j < 3; ++j) {
      float& r = view.rotation[3 * i + j];
      r = 0;
      for (int k = 0; k < 3; ++k) {
        r += kFlip[i] * head[3 * k + i] * kFlip[k] * anchor.rotation[3 * k + j];
      }
      view.translation[i] -= r * anchor.position[j];
    }
    for (int k = 0; k < 3; ++k) {
      view.translation[i] -= anchor.units_per_metre * kFlip[i] * head[3 * k + i] * position[k];
    }
  }
  return view;
}

}  // namespace xr
