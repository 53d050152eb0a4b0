// SPDX-License-Identifier: Apache-2.0
// Converts an OpenXR eye to a view of STGS.
#pragma once

#include <openxr/openxr.h>
#include <stgs/stgs.h>

namespace xr {

// Pose of the tracking space (metres; x right, y up, z back) in the scene.
struct Anchor {
  // Rows: right, down and forward of the space, in scene axes.
  float rotation[9];
  float position[3];  // of the origin, scene units
  float units_per_metre;
};

// Places the origin at the camera of the first view. Upright and at life size if the file states an
// up direction and a scale; otherwise aligned with the camera, at one unit per metre.
Anchor anchor_at(const stgs_view& start, const stgs_scene_info& info);

// Returns the view of an eye, whose frustum may be asymmetric, for an image of this size over
// black. The near plane is that of the start camera.
stgs_view eye_view(const XrView& eye, const Anchor& anchor, const stgs_view& start, uint32_t width,
                   uint32_t height);

}  // namespace xr
