// SPDX-License-Identifier: Apache-2.0
// From what OpenXR says of an eye to a view of STGS's.
#pragma once

#include <openxr/openxr.h>
#include <stgs/stgs.h>

namespace xr {

// Where the space of the head's poses (metres; x right, y up, z back) lies in the scene.
struct Anchor {
  // Rows: what is right, down and forward of the space's origin, in the scene.
  float rotation[9];
  float position[3];  // of the origin, scene units
  float units_per_metre;
};

// The origin at the first view's camera; upright and as large as life as far as the file tells,
// else as the camera is held, and a unit a metre.
Anchor anchor_at(const stgs_view& start, const stgs_scene_info& info);

// The eye's frustum, whose sides need not be alike, on a picture of that size, over black. Its near
// plane is the start camera's.
stgs_view eye_view(const XrView& eye, const Anchor& anchor, const stgs_view& start, uint32_t width,
                   uint32_t height);

}  // namespace xr
