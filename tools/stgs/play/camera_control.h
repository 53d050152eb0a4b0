// SPDX-License-Identifier: Apache-2.0
// An interactive camera: orbits around a target point, or moves freely.
#pragma once

#include "camera_file.h"
#include "stgs/stgs.h"
#include "vector.h"

namespace stgs::tools {

// Angles are in radians, distances in scene units.
class CameraControl {
 public:
  // Starts at `start`. The target lies on its optical axis, at the depth of the scene's centre. Up
  // is that of the scene, or of the camera if the scene has none.
  CameraControl(const encoder::Camera& start, const stgs_scene_info& scene);

  // Orbits around the target, to the right and up.
  void orbit(double right, double up);
  // Rotates in place, to the right and up.
  void look(double right, double up);
  // Translates along the camera axes, together with the target.
  void move(double right, double up, double forward);
  // Multiplies the distance to the target by `factor` > 0.
  void approach(double factor);
  void reset();

  // Returns the distance to the target, which serves as the scale of movements.
  double distance() const { return distance_; }
  // Returns the camera for an image of `size`: contains the view of the start camera, with square
  // pixels preserved.
  encoder::Camera camera(Size size) const;

 private:
  // Returns a camera axis in world coordinates: 0 right, 1 down, 2 forward.
  Vector3 axis(int row) const;
  // Rotates in place: up, short of the vertical, and to the right about the up direction.
  void rotate(double right, double up);
  Vector3 position() const;  // from the target, the forward axis and the distance
  void set_position(const Vector3& position);

  encoder::Camera start_, now_;
  Vector3 up_, target_, start_target_;
  double distance_ = 0, start_distance_ = 0;
};

// Returns a camera that sees the entire scene, for files without a start camera.
encoder::Camera overview(const stgs_scene_info& scene);

}  // namespace stgs::tools
