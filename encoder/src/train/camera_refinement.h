// SPDX-License-Identifier: Apache-2.0
// Refinement of the training cameras: small corrections of poses, focal lengths, distortion and
// vignetting, or of the times of their frames, learnt with the scene.
#pragma once

#include <cstddef>
#include <vector>

#include "math/camera_grad.h"
#include "math/lens.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/train.h"
#include "train/train_state.h"

namespace stgs::encoder {

// Returns the camera with a correction applied.
Camera corrected(const Camera& camera, const CameraCorrection& correction);
// Returns the lens of a correction.
math::Lens lens_of(const CameraCorrection& correction);
// Returns the capture with the training cameras as they are now, without their lenses.
PreparedCapture with_refined_cameras(const PreparedCapture& capture, const TrainState& state);

// Sets up the refinement of `cameras` training cameras, without corrections.
void begin_refinement(std::size_t cameras, TrainState& state);
// Adds the gradients of a view of a camera to those that the next update uses.
void add_camera_gradient(TrainState& state, std::size_t camera, const math::CameraGrad& gradient,
                         float vignetting);
// How far an update may go.
struct CameraRates {
  // Of angles (radians), of shifts over the distance to the centre of the scene, and of the
  // logarithm of the focal length; 4 times that of the distortion, and 30 times that of the
  // vignetting, so that a run can reach those of common lenses. 0: all of these remain.
  float geometry = 0;
  float pull = 0;  // over that rate
  float time = 0;  // of time shifts, frames; 0: they remain
};

// Applies an Adam step with the mean gradient of the views since the last update to every camera
// that has some. A step moves an angle by at most the rate, and by much less if the views disagree
// on its direction; it then takes back `pull` times the rate. So a camera keeps its calibration
// unless its views agree that it is wrong. A motion, a change of size, a lens or a time shift that
// most cameras share is undone, because other cameras would not follow.
void update_cameras(const PreparedCapture& capture, const CameraRates& rates, TrainState& state);

// Lists the training cameras with their corrections, in the capture's order; empty without
// refinement.
std::vector<RefinedCamera> refined_cameras(const PreparedCapture& capture, const TrainState& state);

}  // namespace stgs::encoder
