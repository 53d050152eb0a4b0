// SPDX-License-Identifier: Apache-2.0
#include "view.h"

#include <algorithm>
#include <cmath>

#include "scene.h"
#include "stgs/format/camera.h"
#include "structs.h"
#include "view_camera.h"

static_assert(STGS_MAX_SIDE == stgs::kMaxImageSide);
static_assert(STGS_MAX_VIEWS == stgs::player::kMaxViews);

using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace stgs::sdk {

stgs_view default_view() {
  stgs_view view{};
  view.struct_size = sizeof(view);
  view.rotation[0] = view.rotation[4] = view.rotation[8] = 1;
  view.fx = view.fy = view.cx = 640;
  view.cy = 360;
  view.width = 1280;
  view.height = 720;
  view.near_plane = SceneMetadata{}.near_plane;
  return view;
}

namespace {

Outcome invalid(std::string message) {
  return {STGS_ERROR_ARGUMENT, std::move(message)};
}

bool is_side(std::uint32_t side) {
  return side >= 1 && side <= STGS_MAX_SIDE;
}

// Ratio of the new image size to the old one.
struct Ratio {
  double x, y;
};

void fit(Ratio ratio, stgs_view& view) {
  const double scale = std::min(ratio.x, ratio.y);
  const double gaze_x = view.fovea_x - static_cast<double>(view.cx);
  const double gaze_y = view.fovea_y - static_cast<double>(view.cy);
  view.fovea_x = static_cast<float>(view.cx * ratio.x + gaze_x * scale);
  view.fovea_y = static_cast<float>(view.cy * ratio.y + gaze_y * scale);
  view.fovea_radius = static_cast<float>(view.fovea_radius * scale);
  view.fx = static_cast<float>(view.fx * scale);
  view.fy = static_cast<float>(view.fy * scale);
}

void stretch(Ratio ratio, stgs_view& view) {
  view.fovea_x = static_cast<float>(view.fovea_x * ratio.x);
  view.fovea_y = static_cast<float>(view.fovea_y * ratio.y);
  view.fovea_radius = static_cast<float>(view.fovea_radius * std::sqrt(ratio.x * ratio.y));
  view.fx = static_cast<float>(view.fx * ratio.x);
  view.fy = static_cast<float>(view.fy * ratio.y);
}

// Gives the caller's view another image size; `scale` sets the focal lengths and the fovea.
stgs_result resize(stgs_view* view, std::uint32_t width, std::uint32_t height,
                   void (*scale)(Ratio, stgs_view&)) {
  stgs_view out = default_view();
  if (const stgs_result bad = copy_in(view, out); bad != STGS_OK) return bad;
  for (const std::uint32_t side : {width, height, out.width, out.height}) {
    if (!is_side(side)) return STGS_ERROR_ARGUMENT;
  }
  const Ratio ratio{static_cast<double>(width) / out.width,
                    static_cast<double>(height) / out.height};
  scale(ratio, out);
  out.cx = static_cast<float>(out.cx * ratio.x);
  out.cy = static_cast<float>(out.cy * ratio.y);
  out.width = width;
  out.height = height;
  for (const float length :
       {out.fx, out.fy, out.cx, out.cy, out.fovea_x, out.fovea_y, out.fovea_radius}) {
    if (!std::isfinite(length)) return STGS_ERROR_ARGUMENT;
  }
  copy_out(view, out);
  return STGS_OK;
}

template <std::size_t N>
bool all_finite(const float (&values)[N]) {
  return std::all_of(values, values + N, [](float v) { return std::isfinite(v); });
}

}  // namespace

Outcome check_view(const stgs_view& view) {
  if (!is_side(view.width) || !is_side(view.height)) {
    return invalid(fmt::format("view: the image has {}x{} pixels (expected 1 to {} per side)",
                               view.width, view.height, STGS_MAX_SIDE));
  }
  const auto positive = [](float v) { return std::isfinite(v) && v > 0; };
  if (!positive(view.fx) || !positive(view.fy) || !std::isfinite(view.cx) ||
      !std::isfinite(view.cy)) {
    return invalid(fmt::format(
        "view: fx {}, fy {}, cx {}, cy {} (expected finite numbers, fx and fy positive)", view.fx,
        view.fy, view.cx, view.cy));
  }
  if (!all_finite(view.rotation) || !is_rotation(view.rotation)) {
    return invalid(
        "view: rotation is not a rotation matrix (expected orthonormal rows, determinant 1)");
  }
  if (!all_finite(view.translation)) return invalid("view: translation is not finite");
  if (!positive(view.near_plane)) {
    return invalid(
        fmt::format("view: near_plane is {} (expected a positive number)", view.near_plane));
  }
  if (!all_finite(view.background)) return invalid("view: background is not finite");
  if (!std::isfinite(view.fovea_x) || !std::isfinite(view.fovea_y) ||
      !std::isfinite(view.fovea_radius) || view.fovea_radius < 0) {
    return invalid(
        fmt::format("view: fovea_x {}, fovea_y {}, fovea_radius {} (expected finite numbers, "
                    "fovea_radius >= 0)",
                    view.fovea_x, view.fovea_y, view.fovea_radius));
  }
  return {};
}

player::View view_of(const stgs_view& view) {
  player::View out;
  out.camera = pinhole_of(camera_of(view), view.near_plane);
  out.background = {view.background[0], view.background[1], view.background[2]};
  if (view.fovea_radius > 0) out.fovea = Fovea{{view.fovea_x, view.fovea_y}, view.fovea_radius};
  return out;
}

}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_view_defaults(stgs_view* view, size_t struct_size) {
  return stgs::sdk::fill_defaults(view, struct_size, stgs::sdk::default_view());
}

stgs_result stgs_view_resize(stgs_view* view, uint32_t width, uint32_t height) {
  return stgs::sdk::resize(view, width, height, stgs::sdk::fit);
}

stgs_result stgs_view_stretch(stgs_view* view, uint32_t width, uint32_t height) {
  return stgs::sdk::resize(view, width, height, stgs::sdk::stretch);
}

stgs_result stgs_scene_start_view(stgs_scene* scene, stgs_view* view) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    STGS_SDK_TRY(stgs::sdk::check_struct(view, "view"));
    const stgs::SceneMetadata& metadata = scene->timeline->metadata();
    stgs_view out = stgs::sdk::default_view();
    if (metadata.near_plane > 0) out.near_plane = metadata.near_plane;
    std::copy_n(metadata.background, 3, out.background);
    if (!metadata.start_camera) {
      stgs::sdk::align_up(metadata.up, out.rotation);
      stgs::sdk::copy_out(view, out);
      return stgs::unsupported("{}: the file has no start camera; use stgs_scene_frame_view",
                               scene->timeline->name());
    }
    stgs::sdk::set_camera(*metadata.start_camera, out);
    stgs::sdk::copy_out(view, out);
    return {};
  });
}

}  // extern "C"
