// SPDX-License-Identifier: Apache-2.0
// The arrangement of the training cameras, which decides how much training relies on priors.
#pragma once

#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "train/vicinity.h"

namespace stgs::encoder {

// A camera's position and viewing direction (unit), world space.
struct RigPose {
  double centre[3];
  double forward[3];
};

RigPose rig_pose(const Camera& camera);

// Returns the poses of the training cameras, in the capture's order.
std::vector<RigPose> training_poses(const PreparedCapture& capture);

// Returns the angle between two cameras, degrees: the larger of the angle between their viewing
// directions and of that under which `scene` sees them.
double rig_angle(const RigPose& a, const RigPose& b, const double scene[3]);

// Returns how sparse a rig is, by the angle to the second nearest camera, the median over the
// cameras. `scene` is a point in the middle of the scene; prepare has an estimate of it before
// training does, so they may differ by a little in the transition. 1 if views between its cameras
// are poorly determined by the images, 0 if priors would only cost detail. It falls from 1 to 0 as
// the number of cameras grows from 17 to 27, and as that angle falls from 17 to 14 degrees.
double rig_sparsity(const std::vector<RigPose>& poses, const double scene[3]);
double rig_sparsity(const PreparedCapture& capture);

// Returns the ball within which size limits are absolute. It holds nearly all content but sky and
// far background.
Vicinity vicinity_of(const PreparedCapture& capture);

}  // namespace stgs::encoder
