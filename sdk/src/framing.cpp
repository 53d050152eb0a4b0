// SPDX-License-Identifier: Apache-2.0
// Places a camera so that its image shows the bounds of a scene.
#include <algorithm>
#include <cmath>

#include "scene.h"
#include "structs.h"
#include "view.h"

using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace stgs::sdk {
namespace {

constexpr double kMargin = 1.125;             // factor: primitives extend beyond their centres
constexpr double kMinThickness = 1 / 16.0;    // relative to the longest side of the box
constexpr double kMaxDistance = 0x1p60;       // rendering needs its square as a float
constexpr double kFloatResolution = 0x1p-22;  // relative to a position: 2 to 4 float steps

// Half a metre in scene units; half a scene unit if the scale is not known.
double half_metre(const SceneMetadata& metadata) {
  return 0.5 / (metadata.metres_per_unit > 0 ? metadata.metres_per_unit : 1.0);
}

struct Box {
  double centre[3];
  double half[3];  // half-lengths of the sides, > 0
};

Box box_of(const SceneMetadata& metadata) {
  Box box{};
  double longest = 0, farthest = 0;
  for (int i = 0; i < 3; ++i) {
    const double low = metadata.bounds_min[i], high = metadata.bounds_max[i];
    box.centre[i] = (low + high) / 2;
    box.half[i] = (high - low) / 2;
    longest = std::max(longest, box.half[i]);
    farthest = std::max(farthest, std::abs(box.centre[i]));
  }
  // Positions closer than this are a single point with rounding errors.
  const double point = std::max(kFloatResolution * farthest, 1 / kMaxDistance);
  const double min_half =
      longest > point ? kMinThickness * longest : std::max(half_metre(metadata), point);
  for (double& half : box.half) half = std::max(half, min_half);
  return box;
}

// Offset of a corner from the centre of the box, along the camera's axes. Bit i of `corner` selects
// the side of axis i.
struct Offset {
  double x, y, z;
};
Offset offset_of(const Box& box, int corner, const float (&rotation)[9]) {
  double along[3] = {0, 0, 0};
  for (int row = 0; row < 3; ++row) {
    for (int i = 0; i < 3; ++i) {
      along[row] += rotation[3 * row + i] * ((corner >> i & 1) != 0 ? box.half[i] : -box.half[i]);
    }
  }
  return {along[0], along[1], along[2]};
}

struct Distance {
  double centre;   // camera z of the centre of the box, > 0
  double nearest;  // smallest camera z of the box, > 0
};

// Distance at which the whole box is visible and its centre is at the centre of the image. A corner
// at offset (x, y, z) has 0 <= u <= width if centre * width / 2 >=
// max(-(fx x + cx z), fx x + (cx - width) z), and likewise for v.
Distance distance_of(const Box& box, const stgs_view& view) {
  const double width = view.width, height = view.height;
  double centre = 0, front = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Offset at = offset_of(box, corner, view.rotation);
    const double u = view.fx * at.x + view.cx * at.z, v = view.fy * at.y + view.cy * at.z;
    centre = std::max({centre, -u / (width / 2), (u - width * at.z) / (width / 2),
                       -v / (height / 2), (v - height * at.z) / (height / 2)});
    front = std::max(front, -at.z);
  }
  return {kMargin * centre, kMargin * centre - front};
}

Outcome frame_view(const SceneMetadata& metadata, const std::string& name, stgs_view& view) {
  const Box box = box_of(metadata);
  const Distance distance = distance_of(box, view);
  const double middle[3] = {(view.width / 2.0 - view.cx) / view.fx,
                            (view.height / 2.0 - view.cy) / view.fy, 1};
  for (int row = 0; row < 3; ++row) {
    double out = distance.centre * middle[row];
    for (int i = 0; i < 3; ++i) out -= view.rotation[3 * row + i] * box.centre[i];
    if (!(std::abs(out) < kMaxDistance)) {
      return unsupported(
          "{}: the bounds are too large to be framed (the camera would be {:.3g} units away)", name,
          std::abs(out));
    }
    view.translation[row] = static_cast<float>(out);
  }
  view.near_plane = std::min(view.near_plane, static_cast<float>(distance.nearest / 2));
  return {};
}

}  // namespace

void align_up(const float (&up)[3], float (&rotation)[9]) {
  const double length = std::hypot(up[0], up[1], up[2]);
  if (!(length > 0)) return;
  double down[3], forward[3] = {0, 0, 0}, size = 0;
  for (int i = 0; i < 3; ++i) down[i] = -up[i] / length;
  const int ahead = std::abs(down[2]) < 0.9 ? 2 : 1;
  for (int i = 0; i < 3; ++i) {
    forward[i] = (i == ahead ? 1 : 0) - down[ahead] * down[i];
    size = std::hypot(size, forward[i]);
  }
  for (double& v : forward) v /= size;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    rotation[i] = static_cast<float>(down[j] * forward[k] - down[k] * forward[j]);
    rotation[3 + i] = static_cast<float>(down[i]);
    rotation[6 + i] = static_cast<float>(forward[i]);
  }
}

}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_scene_frame_view(stgs_scene* scene, stgs_view* view) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    stgs_view out = stgs::sdk::default_view();
    STGS_SDK_TRY(stgs::sdk::copy_in(view, out, "view"));
    STGS_SDK_TRY(stgs::sdk::check_view(out));
    const stgs::player::Timeline& timeline = *scene->timeline;
    STGS_SDK_TRY(stgs::sdk::frame_view(timeline.metadata(), timeline.name(), out));
    stgs::sdk::copy_out(view, out);
    return {};
  });
}

}  // extern "C"
