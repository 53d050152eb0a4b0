// SPDX-License-Identifier: Apache-2.0
// A viewpoint that a viewer moves: around a point, or freely.
#pragma once

#include "camera_file.h"
#include "stgs/format/math/lang.h"

namespace stgs::tools {

// Angles in radians, distances in scene units.
class CameraControl {
 public:
  // Begins at `start`. The point that it turns around lies ahead of it, as far as the middle of the
  // scene; up is the scene's, or the camera's where the scene does not say.
  CameraControl(const encoder::Camera& start, const SceneMetadata& scene);

  // Around the point: to the right, and up.
  void orbit(double right, double up);
  // On the spot.
  void look(double right, double up);
  // Along the camera's own axes, the point with it.
  void move(double right, double up, double forward);
  // To so much of the distance to the point; > 0.
  void approach(double factor);
  void reset();

  // To the point; a measure of how large things are.
  double distance() const { return distance_; }
  // In a picture of another size: all that the start camera sees, no pixel stretched.
  encoder::Camera camera(Size size) const;

 private:
  math::Vec3 axis(int row) const;  // of the camera, in the world: 0 right, 1 down, 2 forward
  // Up, as far as that is not overhead, and to the right about the scene's up, on the spot.
  void turn(double right, double up);
  math::Vec3 place() const;
  void set_place(math::Vec3 place);

  encoder::Camera start_, now_;
  math::Vec3 up_, point_, start_point_;
  double distance_ = 0, start_distance_ = 0;
};

// A camera that sees the whole scene, for files without a start camera.
encoder::Camera overview(const SceneMetadata& scene);

}  // namespace stgs::tools
